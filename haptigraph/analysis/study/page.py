"""The report as one self-contained HTML page, without scripts and external resources, for light and dark."""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources

import pandas as pd
from msgspec import Struct

from haptigraph.analysis.study.paper import Beside
from haptigraph.analysis.study.results_table import Table, number

__all__ = ["Picture", "document", "figure_html", "page", "table_html"]

SCREEN_PX_PER_MM = 5.6
"""Figures are drawn for print; on a screen they are half as large again."""
STYLE = (resources.files("haptigraph.analysis.study") / "report.css").read_text("utf-8")


class Picture(Struct, frozen=True):
    """A figure with its caption, which is also its text alternative."""

    name: str
    svg: bytes
    caption: str
    width_mm: float


def document(title: str, parts: Sequence[str]) -> str:
    """Return a self-contained page of parts in HTML, empty ones left out."""
    body = "\n".join(part for part in parts if part)
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n"
        f"<style>\n{STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def page(
    title: str,
    facts: str,
    marks: Sequence[str],
    findings: Sequence[str],
    tables: Sequence[Table],
    beside: Beside | None,
    pictures: Sequence[Picture],
    paragraphs: Sequence[str],
    details: Mapping[str, tuple[str, pd.DataFrame]],
    tex: str,
) -> str:
    """Return the page.

    Args:
        title: Of the study.
        facts: One line about it.
        marks: Prominent notes at the top, such as that it was simulated.
        findings: The results in sentences.
        tables: The paper's first.
        beside: The study beside the paper.
        pictures: Of the study.
        paragraphs: Of the methods.
        details: Further tables: title, and data, by name.
        tex: The tables in LaTeX.
    """
    marked = "\n".join(f'<p class="mark">{escape(mark)}</p>' for mark in marks)
    parts = [
        f"<h1>{escape(title)}</h1>\n{marked}\n<p class='quiet'>{escape(facts)}</p>",
        "<h2>Results</h2>",
        *(f"<p>{escape(finding)}</p>" for finding in findings),
        *(table_html(table) for table in tables),
        *(_beside(beside) if beside else ()),
        "<h2>Figures</h2>" if pictures else "",
        *(figure_html(picture) for picture in pictures),
        "<h2>Methods</h2>",
        *(f"<p>{escape(paragraph)}</p>" for paragraph in paragraphs),
        "<h2>Details</h2>",
        *(_details(heading, frame) for heading, frame in details.values()),
        f"<details><summary>LaTeX</summary><pre>{escape(tex)}</pre></details>",
        "<p class='quiet'>haptigraph is research software, not a medical device.</p>",
    ]
    return document(title, parts)


def _beside(beside: Beside) -> list[str]:
    notes = [f"<p>{escape(note)}</p>" for note in beside.notes]
    return ["<h2>Beside the paper</h2>", table_html(beside.table), *notes]


def table_html(table: Table) -> str:
    """Return a table."""
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in table.head)
    rows = "\n".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows
    )
    return (
        f'<div class="wide"><table><caption>{escape(table.caption)}</caption>\n'
        f"<thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table></div>"
    )


def figure_html(picture: Picture) -> str:
    """Return a figure with its caption."""
    data = base64.b64encode(picture.svg).decode()
    caption = escape(picture.caption)
    width_px = round(SCREEN_PX_PER_MM * picture.width_mm)
    return (
        f'<figure><img alt="{caption}" width="{width_px}" src="data:image/svg+xml;base64,{data}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _details(title: str, frame: pd.DataFrame) -> str:
    head = "".join(f'<th scope="col">{escape(str(name).replace("_", " "))}</th>' for name in frame.columns)
    rows = "\n".join(
        "<tr>" + "".join(f"<td>{escape(_cell(value))}</td>" for value in row) + "</tr>"
        for row in frame.itertuples(index=False)
    )
    return (
        f'<details><summary>{escape(title)}</summary><div class="wide"><table class="words">\n'
        f"<thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table></div></details>"
    )


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    if value != 0 and abs(value) < 1e-3:
        return f"{value:.2g}"
    return f"{value:g}" if value.is_integer() and abs(value) < 1e6 else number(value, 4)
