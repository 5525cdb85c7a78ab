"""The frozen protocol as files to publish: its texts, and the wording of every item as a table."""

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

from haptigraph.study.protocol import FILE, Protocol
from haptigraph.study.sharing.rekeying import without_contacts

__all__ = ["publishable_parts", "write_items", "write_parts"]

COLUMNS = (
    *("questionnaire", "title", "source", "intro", "when", "item", "text", "kind"),
    *("low", "low_label", "high", "high_label", "choices", "unit", "required"),
)


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


def write_items(path: Path, protocol: Protocol) -> None:
    """Write the items of all questionnaires as CSV, in the order of the study, without contacts."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        table.writerows([without_contacts(str(cell))[0] for cell in row] for row in _items(protocol))


def _path_of(part: str) -> PurePosixPath:
    """Return where a part belongs; "procedure NAME" without a suffix ships with haptigraph."""
    _, _, name = part.partition(" ")
    path = PurePosixPath(name or FILE)
    if path.is_absolute() or ".." in path.parts or "\\" in name:
        path = PurePosixPath(path.name.rpartition("\\")[2])
    return path if path.suffix == ".toml" else path.with_name(f"{path.name}.toml")


def _items(protocol: Protocol) -> Iterator[tuple[object, ...]]:
    for when in ("start", "condition", "end"):
        for table, each in protocol.questionnaires:
            for item in each.items if table.when == when else ():
                yield (
                    *(each.name, each.title, each.source, each.intro, when, item.key, item.text, item.kind),
                    *(
                        item.low,
                        item.low_label,
                        item.high,
                        item.high_label,
                        " | ".join(item.choices),
                        item.unit,
                    ),
                    "yes" if item.required else "no",
                )
