"""Read the frozen parts of a protocol, and compare them with those of today by their content."""

import hashlib
import warnings
from collections.abc import Mapping
from functools import lru_cache

from msgspec.structs import replace

from haptigraph.assemble import parse_procedure
from haptigraph.errors import BadInput, RenamedKey
from haptigraph.study.questionnaire import Questionnaire, parse_questionnaire

__all__ = ["frozen_questionnaires", "is_same_part", "sha256_of_parts"]


def is_same_part(name: str, frozen: str | None, text: str | None) -> bool:
    """Return whether a part of a protocol is what was frozen; None: there is no such part.

    A score may have been added to a questionnaire: earlier versions scored nothing but the SUS.
    """
    if frozen == text:
        return True
    before, now = _content(name, frozen), _content(name, text)
    if isinstance(before, Questionnaire) and isinstance(now, Questionnaire) and before.score is None:
        now = replace(now, score=None)
    return before == now


def sha256_of_parts(parts: Mapping[str, str]) -> str:
    """Return the SHA-256 of all parts of a protocol."""
    return hashlib.sha256("".join(f"{key}\0{parts[key]}\0" for key in sorted(parts)).encode()).hexdigest()


def frozen_questionnaires(parts: Mapping[str, str]) -> dict[str, Questionnaire]:
    """Return the questionnaires among frozen parts by the name of their part, those that can be read."""
    found = {name: _content(name, text) for name, text in parts.items()}
    return {name: each for name, each in found.items() if isinstance(each, Questionnaire)}


@lru_cache(maxsize=64)
def _content(part: str, text: str | None) -> object:
    """Parse a procedure or questionnaire, without comments and without prose that participants never see."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RenamedKey)
            if text is not None and part.startswith("procedure "):
                procedure = parse_procedure(text, part)
                states = tuple(replace(state, because="") for state in procedure.states)
                return replace(procedure, text="", title="", source="", states=states)
            if text is not None and part.startswith("questionnaire "):
                return replace(parse_questionnaire(text, part), text="")
    except BadInput:  # of a version that is not compatible
        pass
    return text
