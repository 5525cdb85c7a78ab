"""A study's protocol: one TOML file, with the procedures and questionnaires it names, loaded and checked.

Every mistake is told with file, line, what was found and what would be valid. Knows no store and no page.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from msgspec import Meta, Struct, field

from haptigraph.assemble import load_procedure
from haptigraph.errors import BadInput, unknown_name
from haptigraph.study.conditions import Order
from haptigraph.study.questionnaire import Questionnaire, load_questionnaire
from haptigraph.toml_document import Document

__all__ = [
    "FILE",
    "Asked",
    "Condition",
    "Protocol",
    "Stop",
    "StudyTable",
    "Target",
    "Texts",
    "Training",
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
    """Every participant meets all conditions, or one."""
    participants: Annotated[int, Meta(ge=1, le=100_000)]
    """How many; no more are taken."""
    seed: Annotated[int, Meta(ge=0, le=2**32 - 1)]
    """Of every order that is drawn."""
    order: Order = "balanced"
    """How the order of conditions is found, or with `between` who gets which."""
    blind: Literal["nobody", "participant", "everyone"] = "participant"
    """From whom the names of conditions are hidden; they see "condition 1", "condition 2", as they come."""


class Condition(Struct, frozen=True, forbid_unknown_fields=True):
    """One condition: what is felt and what is seen."""

    name: Name
    title: str
    procedure: str = "subretinal_injection"
    """Name of a procedure that ships with haptigraph, or a path from the protocol's folder."""
    touch: bool = True
    """Whether the hand feels anything."""
    display: Literal["ioct", "overlays"] = "ioct"
    """What the participant sees: the iOCT-like picture, or with what was found drawn over it."""


class Training(Struct, frozen=True, forbid_unknown_fields=True):
    """The [training] table; without it there is none."""

    before: Literal["study", "condition"]
    """Once before the first condition, or before each, under it."""
    condition: str = ""
    """The one that is trained, where training comes once."""
    trials: Count = 1
    timeout_s: TimeoutS = 300.0
    free: bool = True
    """Whether Target Hit does not end it."""


class Trials(Struct, frozen=True, forbid_unknown_fields=True):
    """The [trials] table: what is done under each condition."""

    repetitions: Count = 1
    """Trials in a block."""
    blocks: Count = 1
    timeout_s: TimeoutS = 300.0
    attempts: Count = 3
    """How often a trial is begun, at most, if it is aborted or interrupted."""
    target_order: Order = "balanced"


class Target(Struct, frozen=True, forbid_unknown_fields=True):
    """A place on the retina."""

    name: Name
    along_mm: Annotated[float, Meta(ge=-15, le=15)]
    """Along the retina from the globe's lowest point, positive to the surgeon's right."""


class Asked(Struct, frozen=True, forbid_unknown_fields=True):
    """When a questionnaire is asked."""

    file: str
    """Name of a questionnaire that ships with haptigraph, or a path from the protocol's folder."""
    when: Literal["start", "condition", "end"]
    """Before training, after every condition, or last."""


class Stop(Struct, frozen=True, forbid_unknown_fields=True):
    """The [stop] table: when a participant's session ends early; 0: never."""

    timeouts_in_a_row: Number = 0
    failed_trials: Number = 0
    """Trials given up after all attempts."""
    session_min: Number = 0
    """Minutes since the consent; no new trial begins after them."""


class Texts(Struct, frozen=True, forbid_unknown_fields=True):
    """The [texts] table: what participants read."""

    briefing: str
    consent: str
    """What they agree to."""
    thanks: str = "That was all. Thank you!"
    break_text: str = ""
    """Between conditions; empty: no break."""


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    study: StudyTable
    texts: Texts
    conditions: tuple[Condition, ...] = field(name="condition")
    targets: tuple[Target, ...] = field(name="target")
    trials: Trials = Trials()
    training: Training | None = None
    questionnaires: tuple[Asked, ...] = field(name="questionnaire", default=())
    stop: Stop = Stop()


class Protocol(Struct, frozen=True):
    """A checked protocol."""

    study: StudyTable
    texts: Texts
    conditions: tuple[Condition, ...]
    targets: tuple[Target, ...]
    trials: Trials
    training: Training | None
    asked: tuple[tuple[Asked, Questionnaire], ...]
    """Questionnaires, in the order of the file."""
    stop: Stop
    procedures: dict[str, str]
    """Text of each procedure that a condition names."""
    parts: dict[str, str]
    """Every text it consists of, by what it is; these are frozen together."""
    folder: Path
    """Where the file stands."""

    @property
    def sha256(self) -> str:
        """Fingerprint of all parts."""
        return hashlib.sha256(
            "".join(f"{key}\0{self.parts[key]}\0" for key in sorted(self.parts)).encode()
        ).hexdigest()

    def condition(self, name: str) -> Condition:
        """Return a condition that is known to be there."""
        return next(condition for condition in self.conditions if condition.name == name)

    def target(self, name: str) -> Target:
        """Return a target that is known to be there."""
        return next(target for target in self.targets if target.name == name)

    def questionnaire(self, name: str) -> Questionnaire:
        """Return a questionnaire that is known to be there."""
        return next(sheet for _, sheet in self.asked if sheet.name == name)

    def procedure_path(self, condition: Condition) -> str:
        """Return a condition's procedure as `run.procedure` takes it."""
        return _from(self.folder, condition.procedure)


def load_protocol(path: str | Path) -> Protocol:
    """Read and check a protocol.

    Args:
        path: The file, or the folder with `study.toml`.

    Raises:
        BadInput: With file, line and reason, if it or what it names cannot be read or is not sound.
    """
    path = Path(path)
    document = Document.read(path / FILE if path.is_dir() else path)
    data = document.convert(_File)
    folder = Path(document.file).parent
    _check_names(document, data)
    _check_training(document, data)
    parts = {FILE: document.text}
    procedures = {}
    for number, condition in enumerate(data.conditions):
        place = f"condition[{number}].procedure"
        loaded = _named(document, place, load_procedure, _from(folder, condition.procedure))
        procedures[condition.procedure] = parts[f"procedure {condition.procedure}"] = loaded.text
    asked: list[tuple[Asked, Questionnaire]] = []
    for number, ask in enumerate(data.questionnaires):
        place = f"questionnaire[{number}].file"
        sheet = _named(document, place, load_questionnaire, _from(folder, ask.file))
        if sheet.name in [other.name for _, other in asked]:
            raise document.error(f"questionnaire {sheet.name!r} is asked twice; once is enough", place)
        asked.append((ask, sheet))
        parts[f"questionnaire {ask.file}"] = sheet.text
    return Protocol(
        study=data.study,
        texts=data.texts,
        conditions=data.conditions,
        targets=data.targets,
        trials=data.trials,
        training=data.training,
        asked=tuple(asked),
        stop=data.stop,
        procedures=procedures,
        parts=parts,
        folder=folder,
    )


def _from(folder: Path, name: str) -> str:
    return str(folder / name) if name.endswith(".toml") else name


def _named(document: Document, place: str, load: Callable[[str], T], name: str) -> T:
    """Load what a key names; if there is no such thing, the mistake is the protocol's."""
    try:
        return load(name)
    except BadInput as error:
        if error.file and error.place:
            raise  # the mistake is in that file
        raise document.error(str(error), place) from None


def _check_names(document: Document, data: _File) -> None:
    for kind, names in (
        ("condition", [condition.name for condition in data.conditions]),
        ("target", [target.name for target in data.targets]),
    ):
        if not names:
            raise document.error(f"no [[{kind}]] at all; at least one is needed", "study")
        for number, name in enumerate(names):
            if name in names[:number]:
                raise document.error(f"a second {kind} {name!r}; names must differ", f"{kind}[{number}].name")
    for key in ("briefing", "consent"):
        if not getattr(data.texts, key).strip():
            raise document.error(f"{key} is empty; participants must read one", f"texts.{key}")


def _check_training(document: Document, data: _File) -> None:
    training = data.training
    if training is None:
        return
    names = [condition.name for condition in data.conditions]
    if training.before == "condition" and training.condition:
        raise document.error(
            "training before each condition is under it; leave condition out", "training.condition"
        )
    if training.before == "study" and data.study.design == "between":
        if training.condition:
            raise document.error(
                "with design between, training is under the participant's own condition; leave condition out",
                "training.condition",
            )
    elif training.before == "study" and training.condition not in names:
        raise document.error(unknown_name("condition", training.condition, names), "training.condition")
