"""The README of a bundle: what it contains, what was left out, how its results are reproduced."""

from collections.abc import Mapping, Sequence
from importlib import resources

from msgspec import Struct

from haptigraph.study.exchange.exporting import About
from haptigraph.study.sharing.rekeying import ORIGIN
from haptigraph.version import __version__

__all__ = ["Contents", "readme"]

TEMPLATE = (resources.files("haptigraph.analysis.study.bundle") / "readme.md").read_text("utf-8")


class Contents(Struct, frozen=True):
    """What a README states about the data."""

    participants: int
    """Whose data are included."""
    recordings: int
    left_out: Mapping[str, int]
    contacts: int
    """Replaced in the protocol's texts."""
    unique: tuple[Sequence[str], Sequence[str]]
    """Columns, and who has a combination of them that nobody else has."""


def readme(about: About, contents: Contents) -> str:
    """Return the text, in Markdown."""
    left_out = [f"* {what}: {count}" for what, count in contents.left_out.items()]
    if contents.contacts:
        replaced = "replaced in the protocol's texts, whose SHA-256 is therefore another one"
        left_out.append(f"* e-mail addresses and telephone numbers, {replaced}: {contents.contacts}")
    return TEMPLATE.format(
        title=about.title,
        mark="**SIMULATED: no people took part.** " if about.simulated else "",
        study=about.study,
        participants=contents.participants,
        recordings=contents.recordings,
        version=__version__,
        origin=f"{ORIGIN:%Y-%m-%d}",
        left_out="\n".join(left_out or ["* nothing else"]),
        warning=_warning(*contents.unique),
    )


def _warning(columns: Sequence[str], people: Sequence[str]) -> str:
    if not people:
        return ""
    return (
        f"\n**Participants whose combination of {', '.join(columns)} nobody else has: {len(people)}.** "
        "Who knows these facts about a person can find their data.\n"
    )
