"""The names that the C sources of the package export."""

import re
from pathlib import Path

__all__ = ["exported_names"]

EXPORTED = re.compile(r"(?<!define )\bEXPORT\b[^;{=]*?\b([a-z]\w*)(?:\(|\[\]| =)")


def exported_names(sources: Path) -> set[str]:
    """Return the names that C sources export."""
    texts = [file.read_text(encoding="utf-8") for file in sorted(sources.rglob("*.[ch]"))]
    return {name for text in texts for name in EXPORTED.findall(text)}
