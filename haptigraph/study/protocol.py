"""A study's protocol: one TOML file with the procedures and questionnaires that it names, loaded and checked.

Every error reports file and line, what was found and what would be valid.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from msgspec import Meta, Struct, field

from haptigraph.assemble import load_procedure
from haptigraph.errors import BadInput
from haptigraph.messages import Pattern
from haptigraph.study.conditions import Order
from haptigraph.study.frozen.analysis_plan import Analysis, check_analysis, numeric_measures
from haptigraph.study.frozen.parts import is_same_part, sha256_of_parts
from haptigraph.study.frozen.quality import Quality
from haptigraph.study.preparation.calibration import Calibration, checked_calibration
from haptigraph.study.preparation.training import Training, check_training
from haptigraph.study.questionnaire import Questionnaire, load_questionnaire
from haptigraph.toml_document import Document

__all__ = [
    "FILE",
    "Condition",
    "Protocol",
    "QuestionnaireTable",
    "Stop",
    "StudyTable",
    "Target",
    "Texts",
    "Trials",
    "load_protocol",
]

T = TypeVar("T")
FILE = "study.toml"
Name = Annotated[str, Meta(pattern="^[A-Za-z0-9][A-Za-z0-9_.-]{0,59}$")]
Count = Annotated[int, Meta(ge=1, le=1000)]
Number = Annotated[int, Meta(ge=0, le=100_000)]
TimeoutS = Annotated[float, Meta(gt=0, le=36_000)]


class StudyTable(Struct, frozen=True, forbid_unknown_fields=True):
    """The [study] table."""

    name: Name
    """Its key in the store."""
    title: str
    design: Literal["within", "between"]
    """Whether every participant meets all conditions or one."""
    participants: Annotated[int, Meta(ge=1, le=100_000)]
    """Sample size; no more can be enrolled."""
    seed: Annotated[int, Meta(ge=0, le=2**32 - 1)]
    """Of every randomised order."""
    order: Order = "balanced"
    """How the conditions are ordered or, with `between`, assigned."""
    blind: Literal["nobody", "participant", "everyone"] = "participant"
    """To whom the conditions' names are hidden; they see "condition 1", "condition 2", in their order."""


class Condition(Struct, frozen=True, forbid_unknown_fields=True):
    """One condition: its haptic output and its display."""

    name: Name
    title: str
    procedure: str = "subretinal_injection"
    """Name of a procedure that ships with haptigraph, or a path from the protocol's folder."""
    touch: bool | Literal["sham"] = True
    """Whether there is haptic output; "sham": at random times, whatever the state. It warns of nothing."""
    sham_duty: Annotated[float, Meta(gt=0, lt=1)] | None = None
    """Expected share of the time that a sham vibrates; unset: half of it."""
    display: Literal["ioct", "overlays"] = "ioct"
    """What the participant sees: the iOCT-like image without or with detections drawn on it."""

    @property
    def touch_text(self) -> str:
        """The haptic output in a word: on, off or sham."""
        return "sham" if self.touch == "sham" else "on" if self.touch else "off"


class Trials(Struct, frozen=True, forbid_unknown_fields=True):
    """The [trials] table: the trials under each condition."""

    repetitions: Count = 1
    """Trials in a block."""
    blocks: Count = 1
    timeout_s: TimeoutS = 300.0
    attempts: Count = 3
    """Maximum number of attempts at a trial that is aborted or interrupted."""
    target_order: Order = "balanced"


class Target(Struct, frozen=True, forbid_unknown_fields=True):
    """A target position on the retina."""

    name: Name
    along_mm: Annotated[float, Meta(ge=-15, le=15)]
    """Arc length along the retina from the globe's lowest point, positive to the surgeon's right."""


class QuestionnaireTable(Struct, frozen=True, forbid_unknown_fields=True):
    """One [[questionnaire]] table: which questionnaire is administered, and when."""

    file: str
    """Name of a questionnaire that ships with haptigraph, or a path from the protocol's folder."""
    when: Literal["start", "condition", "end"]
    """Before training, after every condition, or last."""


class Stop(Struct, frozen=True, forbid_unknown_fields=True):
    """The [stop] table: when a participant's session ends early; 0 switches a rule off."""

    timeouts_in_a_row: Number = 0
    failed_trials: Number = 0
    """Trials without a valid attempt."""
    session_min: Number = 0
    """Minutes since the consent after which no new trial begins."""


class Texts(Struct, frozen=True, forbid_unknown_fields=True):
    """The [texts] table: what participants read."""

    briefing: str
    consent: str
    """What they consent to."""
    thanks: str = "That was all. Thank you!"
    break_text: str = ""
    """Shown between conditions; empty: no break."""


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    study: StudyTable
    texts: Texts
    conditions: tuple[Condition, ...] = field(name="condition")
    targets: tuple[Target, ...] = field(name="target")
    trials: Trials = Trials()
    training: Training | None = None
    calibration: Calibration | None = None
    questionnaires: tuple[QuestionnaireTable, ...] = field(name="questionnaire", default=())
    stop: Stop = Stop()
    analysis: Analysis | None = None
    quality: Quality = Quality()


class Protocol(Struct, frozen=True):
    """A checked protocol."""

    study: StudyTable
    texts: Texts
    conditions: tuple[Condition, ...]
    targets: tuple[Target, ...]
    trials: Trials
    training: Training | None
    calibration: Calibration | None
    questionnaires: tuple[tuple[QuestionnaireTable, Questionnaire], ...]
    """In the order of the file."""
    stop: Stop
    quality: Quality
    procedures: dict[str, str]
    """Text of each procedure that a condition names."""
    patterns: dict[str, tuple[Pattern, ...]]
    """Patterns of each of them."""
    parts: dict[str, str]
    """All texts of the protocol by name; they are frozen together."""
    folder: Path
    """The folder that contains the file."""
    analysis: Analysis | None = None
    """What was decided before the data, if anything."""

    @property
    def sha256(self) -> str:
        """SHA-256 of all parts."""
        return sha256_of_parts(self.parts)

    def condition(self, name: str) -> Condition:
        """Return an existing condition."""
        return next(condition for condition in self.conditions if condition.name == name)

    def target(self, name: str) -> Target:
        """Return an existing target."""
        return next(target for target in self.targets if target.name == name)

    def questionnaire(self, name: str) -> Questionnaire:
        """Return an existing questionnaire."""
        return next(found for _, found in self.questionnaires if found.name == name)

    def procedure_path(self, condition: Condition) -> str:
        """Return a condition's procedure as a value of `run.procedure`."""
        return _procedure_from(self.folder, condition.procedure)

    def changed_parts(self, frozen: Mapping[str, str]) -> list[str]:
        """Return the names of the parts that differ from the frozen ones.

        `study.toml` must be unchanged to the letter. Procedures and questionnaires may be worded differently,
        as another version of haptigraph ships them, if they have the same content.
        """
        return sorted(
            name
            for name in frozen.keys() | self.parts.keys()
            if not is_same_part(name, frozen.get(name), self.parts.get(name))
        )


def load_protocol(path: str | Path) -> Protocol:
    """Read and check a protocol.

    Args:
        path: The file, or the folder with `study.toml`.

    Raises:
        BadInput: If it or a file that it names cannot be read or is invalid, with file, line and reason.
    """
    path = Path(path)
    document = Document.read(path / FILE if path.is_dir() else path)
    data = document.convert(_File)
    folder = Path(document.file).parent
    _check_names(document, data)
    names = [condition.name for condition in data.conditions]
    if data.training is not None:
        check_training(document, data.training, data.study.design, names)
    _check_sham(document, data)
    parts = {FILE: document.text}
    procedures, patterns, states = {}, {}, set[str]()
    for number, condition in enumerate(data.conditions):
        key = f"condition[{number}].procedure"
        loaded = _load(document, key, load_procedure, _procedure_from(folder, condition.procedure))
        procedures[condition.procedure] = parts[f"procedure {condition.procedure}"] = loaded.text
        patterns[condition.procedure] = loaded.patterns
        states |= {state.name for state in loaded.states}
    calibration = data.calibration
    if calibration is not None:
        touched = {each.name: patterns[each.procedure] for each in data.conditions if each.touch}
        calibration = checked_calibration(document, calibration, touched)
    questionnaires: list[tuple[QuestionnaireTable, Questionnaire]] = []
    for number, table in enumerate(data.questionnaires):
        key = f"questionnaire[{number}].file"
        found = _load(document, key, load_questionnaire, _from(folder, table.file))
        if found.name in [other.name for _, other in questionnaires]:
            raise document.error(f"questionnaire {found.name!r} occurs twice; remove one of them", key)
        questionnaires.append((table, found))
        parts[f"questionnaire {table.file}"] = found.text
    if data.analysis is not None:
        scales = [each.scales for table, each in questionnaires if table.when == "condition"]
        measures = numeric_measures(states, [scale.name for each in scales for scale in each])
        trials = data.trials.blocks * data.trials.repetitions
        check_analysis(document, data.analysis, names, measures, trials, data.quality)
    return Protocol(
        study=data.study,
        texts=data.texts,
        conditions=data.conditions,
        targets=data.targets,
        trials=data.trials,
        training=data.training,
        calibration=calibration,
        questionnaires=tuple(questionnaires),
        stop=data.stop,
        quality=data.quality,
        procedures=procedures,
        patterns=patterns,
        parts=parts,
        folder=folder,
        analysis=data.analysis,
    )


def _procedure_from(folder: Path, name: str) -> str:
    """Return the procedure of a name: that of the study's folder, if it has one, before the shipped one."""
    own = folder / f"{name}.toml"
    return str(own) if own.is_file() else _from(folder, name)


def _from(folder: Path, name: str) -> str:
    return str(folder / name) if name.endswith(".toml") else name


def _load(document: Document, key: str, load: Callable[[str], T], name: str) -> T:
    """Load the file that a key names; attribute a missing file to the protocol."""
    try:
        return load(name)
    except BadInput as error:
        if error.file and error.place:
            raise  # the error is in that file
        raise document.error(str(error), key) from None


def _check_names(document: Document, data: _File) -> None:
    for kind, names in (
        ("condition", [condition.name for condition in data.conditions]),
        ("target", [target.name for target in data.targets]),
    ):
        if not names:
            raise document.error(f"no [[{kind}]]; at least one is required", "study")
        for number, name in enumerate(names):
            if name in names[:number]:
                raise document.error(f"a second {kind} {name!r}; names must differ", f"{kind}[{number}].name")
    for key in ("briefing", "consent"):
        if not getattr(data.texts, key).strip():
            raise document.error(f"{key} is empty; write the text for participants", f"texts.{key}")


def _check_sham(document: Document, data: _File) -> None:
    for number, condition in enumerate(data.conditions):
        if condition.touch != "sham" and condition.sham_duty is not None:
            raise document.error(
                'sham_duty needs touch = "sham"; remove the key', f"condition[{number}].sham_duty"
            )
