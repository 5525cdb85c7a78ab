"""Write a safety case into a folder: Markdown, CSV, the diagram and the page."""

from pathlib import Path

from haptigraph.analysis.evidence.argument import argument_svg
from haptigraph.analysis.evidence.case import SafetyCase
from haptigraph.analysis.evidence.page import page
from haptigraph.analysis.evidence.tables import csv_table, markdown
from haptigraph.errors import BadInput

__all__ = ["FILES", "check_folder", "write_case"]

FILES = {
    "evidence.md": markdown,
    "evidence.csv": csv_table,
    "argument.svg": argument_svg,
    "evidence.html": page,
}


def check_folder(output: str | Path) -> Path:
    """Refuse a folder that holds evidence already, before the work for it begins.

    Raises:
        BadInput: If it does, or is a file.
    """
    folder = Path(output)
    if folder.exists() and not folder.is_dir():
        raise BadInput("is a file; give a folder to write", folder)
    for name in FILES:
        if (folder / name).exists():
            raise BadInput("exists already; delete it or give another folder", folder / name)
    return folder


def write_case(case: SafetyCase, folder: Path) -> None:
    """Write all files of a safety case into a folder, which is made if it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text_of in FILES.items():
        (folder / name).write_text(text_of(case), encoding="utf-8")
