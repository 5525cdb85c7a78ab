"""Read the frozen protocol in an export's `study.json`, as far as an analysis needs it."""

import hashlib
from pathlib import Path

import msgspec
from msgspec import Struct, field

from haptigraph.errors import BadInput
from haptigraph.study.frozen.analysis_plan import Analysis
from haptigraph.study.frozen.parts import frozen_questionnaires, sha256_of_parts
from haptigraph.study.frozen.quality import Quality
from haptigraph.study.questionnaire import Questionnaire

__all__ = ["FrozenCondition", "FrozenProtocol", "read_frozen"]


class FrozenCondition(Struct, frozen=True):
    """A condition of the protocol."""

    name: str
    title: str = ""
    touch: bool | str = True
    """False: no haptic output."""


class FrozenProtocol(Struct, frozen=True):
    """The frozen protocol; empty where an export has none."""

    title: str = ""
    conditions: tuple[FrozenCondition, ...] = ()
    """In the order of the protocol."""
    questionnaires: dict[str, Questionnaire] = {}
    """By name; none that this version cannot read."""
    analysis: Analysis | None = None
    """What was decided before the data, if anything."""
    quality: Quality = Quality()
    """Thresholds of the data's quality."""
    frozen_utc: str = ""
    """When the first participant froze it; empty: not known."""
    sha256: str = ""
    """Of all its texts; empty: not known."""
    edited_parts: tuple[str, ...] | None = None
    """Parts that had been edited when the study was exported; None: not known."""
    procedure_sha256s: frozenset[str] = frozenset()
    """Of its procedures; empty: not known."""

    @property
    def names(self) -> list[str]:
        """The names of the conditions."""
        return [condition.name for condition in self.conditions]

    def titles(self) -> dict[str, str]:
        """Return the titles of the conditions by name; none where two would read the same."""
        titles = {each.name: each.title.strip() for each in self.conditions if each.title.strip()}
        return titles if len(set(titles.values())) == len(titles) else {}


class _Export(Struct, frozen=True):
    title: str = ""
    parts: dict[str, str] = {}
    frozen_utc: str = ""
    protocol_sha256: str = ""
    edited_parts: tuple[str, ...] | None = None


class _StudyFile(Struct, frozen=True):
    conditions: tuple[FrozenCondition, ...] = field(name="condition", default=())
    analysis: Analysis | None = None
    quality: Quality = Quality()


def read_frozen(path: Path) -> FrozenProtocol:
    """Read the frozen protocol.

    Args:
        path: `study.json`; a missing file is an empty protocol.

    Raises:
        BadInput: If it cannot be read.
    """
    if not path.is_file():
        return FrozenProtocol()
    try:
        export = msgspec.json.decode(path.read_bytes(), type=_Export)
        texts = [text for name, text in export.parts.items() if Path(name).name == "study.toml"]
        study = msgspec.toml.decode(texts[0], type=_StudyFile) if texts else _StudyFile()
    except (msgspec.MsgspecError, ValueError, OSError) as error:
        raise BadInput(f"cannot be read: {error}", path) from None
    questionnaires = {each.name: each for each in frozen_questionnaires(export.parts).values()}
    procedures = [text for name, text in export.parts.items() if name.startswith("procedure ")]
    is_original = sha256_of_parts(export.parts) == export.protocol_sha256  # a bundle may lack contacts
    return FrozenProtocol(
        export.title,
        study.conditions,
        questionnaires,
        study.analysis,
        study.quality,
        export.frozen_utc,
        export.protocol_sha256,
        export.edited_parts,
        frozenset(hashlib.sha256(text.encode()).hexdigest() for text in procedures if is_original),
    )
