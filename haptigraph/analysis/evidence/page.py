"""A safety case as one self-contained HTML page, without scripts, for light and dark."""

from html import escape
from importlib import resources

from haptigraph.analysis.evidence.accuracy_evidence import BARS
from haptigraph.analysis.evidence.argument import PAPER, argument_svg
from haptigraph.analysis.evidence.case import Claim, Evidence, HazardCase, SafetyCase
from haptigraph.analysis.evidence.tables import NOTES, facts, outcome, status_text

__all__ = ["page"]

STYLE = (resources.files("haptigraph.analysis.evidence") / "page.css").read_text("utf-8")
SHORT = 12
NOTATION = (
    "Goal Structuring Notation: goals are rectangles, the strategy is a parallelogram, contexts have round "
    "corners, solutions are circles. A diamond marks a goal that is not developed."
)
HEADINGS = ("claim", "status", "figure", "passes if", "made by")


def page(case: SafetyCase) -> str:
    """Return the page."""
    title = f"Evidence: {case.title}"
    colors = {role: f"var(--{role})" for role in PAPER}
    parts = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="outcome{"" if case.holds else " bad"}">{escape(outcome(case))}</p>',
        _problems(case),
        "<dl>" + "".join(f"<dt>{escape(n)}</dt><dd>{escape(v)}</dd>" for n, v in facts(case)) + "</dl>",
        *(f"<p>{escape(note)}</p>" for note in NOTES),
        *(_hazard(case, f"H{place}", hazard) for place, hazard in enumerate(case.hazards, 1)),
        f"<h2>Argument</h2><p class='quiet'>{NOTATION}</p>",
        '<div class="diagram" tabindex="0" role="region" aria-label="Argument">',
        f"{argument_svg(case, colors)}</div>",
        _files(case),
        "<h2>Accuracy bars</h2><ul>",
        *(f"<li>{escape(bar.statement)}: <code>{escape(bar.text)}</code></li>" for bar in BARS),
        "</ul>",
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(part for part in parts if part)
        + "\n</body>\n</html>\n"
    )


def _problems(case: SafetyCase) -> str:
    """Return links to everything that does not hold."""
    lines = [
        f'<li><a href="#{number}">{number}</a> {status_text(claim, each)}: {escape(claim.statement)}</li>'
        for _, _, _, claim, number, each in case.rows()
        if claim.lacks(each)
    ]
    return f'<ul class="problems">{"".join(lines)}</ul>' if lines else ""


def _hazard(case: SafetyCase, name: str, hazard: HazardCase) -> str:
    rows = "\n".join(
        _row(claim_id, claim, number, each)
        for hazard_id, _, claim_id, claim, number, each in case.rows()
        if hazard_id == name
    )
    head = "".join(f'<th scope="col">{heading}</th>' for heading in HEADINGS)
    return (
        f"<h2>{name} {escape(hazard.hazard)}</h2>\n<p class='quiet'>Harm: {escape(hazard.harm)}.</p>\n"
        f"<table><thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table>"
    )


def _files(case: SafetyCase) -> str:
    """Return a list of what the evidence rests on, with all hashes in full."""
    files = dict.fromkeys(
        (each.file, each.sha256, each.version, each.commit, each.made)
        for *_, each in case.rows()
        if each.sha256
    )
    items = "".join(
        f"<dt>{escape(file)}</dt><dd>sha256 {sha256}<br>"
        f"version {escape(version or 'not stated')}, commit {escape(commit or 'not stated')}, {escape(made)}"
        "</dd>"
        for file, sha256, version, commit, made in files
    )
    return f"<h2>Files</h2>\n<dl>{items}</dl>"


def _row(claim_id: str, claim: Claim, number: str, evidence: Evidence) -> str:
    origin = [
        f"<code>{escape(evidence.command)}</code>" if evidence.command else "",
        escape(evidence.file),
        f"sha256 {evidence.sha256[:SHORT]}" if evidence.sha256 else "",
    ]
    cells = (
        ("", "", f"{claim_id} {escape(claim.statement)}"),
        (HEADINGS[1], "status", f"{number} {escape(status_text(claim, evidence))}"),
        (HEADINGS[2], "figure", f"{evidence.source}: {escape(evidence.figure)}"),
        (HEADINGS[3], "", escape(evidence.bar)),
        (HEADINGS[4], "origin", "<br>".join(part for part in origin if part)),
    )
    tds = "".join(f"<td{_attributes(name, kind)}>{text}</td>" for name, kind, text in cells)
    return f'<tr id="{number}"{" class=bad" if claim.lacks(evidence) else ""}>{tds}</tr>'


def _attributes(name: str, kind: str) -> str:
    """Return the attributes of a cell: its heading, for narrow windows, and its class."""
    return (f' data-name="{name}"' if name else "") + (f' class="{kind}"' if kind else "")
