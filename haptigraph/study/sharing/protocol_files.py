"""The frozen protocol as files to publish."""

from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from haptigraph.study.protocol import FILE
from haptigraph.study.sharing.rekeying import without_contacts

__all__ = ["publishable_parts", "write_parts"]


def publishable_parts(parts: Mapping[str, str]) -> tuple[dict[str, str], int]:
    """Replace contacts in the texts of a protocol; return the texts, and the number of contacts."""
    replaced = {name: without_contacts(text) for name, text in parts.items()}
    return {name: text for name, (text, _) in replaced.items()}, sum(count for _, count in replaced.values())


def write_parts(folder: Path, parts: Mapping[str, str]) -> None:
    """Write the texts of a protocol into a new folder, each below the name that `study.toml` gives it."""
    for name, text in parts.items():
        path = folder / _path_of(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")


def _path_of(part: str) -> PurePosixPath:
    """Return where a part belongs; "procedure NAME" without a suffix ships with haptigraph."""
    _, _, name = part.partition(" ")
    path = PurePosixPath(name or FILE)
    if path.is_absolute() or ".." in path.parts or "\\" in name:
        path = PurePosixPath(path.name.rpartition("\\")[2])
    return path if path.suffix == ".toml" else path.with_name(f"{path.name}.toml")
