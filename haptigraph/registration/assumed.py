"""What a registration assumes and nobody measured or stated, and the sentences for it.

The key `assumed` of the file lists names: of positions, by which contacts are judged, and of settings.
"""

from collections.abc import Iterable, Sequence

from haptigraph.toml_document import Document

__all__ = [
    "LENS",
    "MIRROR",
    "POSITIONS",
    "RIM",
    "SCALE",
    "TARGET",
    "TROCAR",
    "assumed_lines",
    "assumed_notes",
    "assumed_text",
    "check_assumed",
    "in_order",
    "needs_consent",
]

TARGET, TROCAR, SCALE, MIRROR, RIM, LENS = "target", "trocar", "scale", "mirror", "rim", "lens"
POSITIONS = ("globe", "retina", TROCAR, TARGET)
WORDS = {
    **{name: f"the {name}" for name in POSITIONS},
    RIM: "the rim's position in the section",
    SCALE: "the scale",
    MIRROR: "the mirroring of the image",
    LENS: "a lens without distortion (points may be more than 3 px off; see haptigraph calibrate)",
}


def check_assumed(document: Document, assumed: Sequence[str]) -> tuple[str, ...]:
    """Return the names of a file's key `assumed`, each once, in the usual order.

    Raises:
        BadInput: If a name is unknown.
    """
    for name in assumed:
        if name not in WORDS:
            raise document.error(f"assumed: unknown name {name!r}; valid: {', '.join(WORDS)}", "assumed")
    return in_order(assumed)


def in_order(assumed: Iterable[str]) -> tuple[str, ...]:
    """Return names in the usual order, each once."""
    names = set(assumed)
    return tuple(name for name in WORDS if name in names)


def needs_consent(assumed: Sequence[str]) -> bool:
    """Return whether a position is assumed, so that nothing may vibrate without the user's consent."""
    return any(name in POSITIONS for name in assumed)


def assumed_text(assumed: Sequence[str]) -> str:
    """Return what is assumed as text: "the target and the scale"; empty if nothing is."""
    *others, last = (WORDS[name] for name in assumed) if assumed else ("",)
    return f"{', '.join(others)} and {last}" if others else last


def assumed_lines(assumed: Sequence[str]) -> list[str]:
    """Return the line of a report that says what is assumed; none if nothing is."""
    return [f"assumed         {assumed_text(assumed)}; not measured"] if assumed else []


def assumed_notes(assumed: Sequence[str], how_to_state: str, *, is_accepted: bool) -> list[str]:
    """Return what to tell the user before a run, one sentence, or none if nothing is assumed.

    Args:
        assumed: Names, as a registration has them.
        how_to_state: What the user does to state a position.
        is_accepted: Whether the user has accepted assumed positions.
    """
    if not assumed:
        return []
    note = f"haptigraph: assumed, not measured: {assumed_text(assumed)}"
    if not needs_consent(assumed):
        return [note]
    if is_accepted:
        return [f"{note}; contacts and hits are judged by it, and haptic output is on (--accept-assumed)"]
    return [f"{note}; haptic output is off: {how_to_state}, or accept it with --accept-assumed"]
