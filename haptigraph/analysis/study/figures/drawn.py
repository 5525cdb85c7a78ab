"""All figures of a report, drawn in every format, with their captions and as LaTeX."""

from collections.abc import Sequence

from msgspec import Struct

from haptigraph.analysis.study.figures.learning import MIN_MEDIAN_N, learning_figure
from haptigraph.analysis.study.figures.motion import alignment_figure, cone_figure
from haptigraph.analysis.study.figures.questionnaires import questionnaire_figure
from haptigraph.analysis.study.figures.raincloud import MIN_DENSITY_N, raincloud_figure
from haptigraph.analysis.study.figures.states import MIN_RATE, box_figure, sequence_figure
from haptigraph.analysis.study.figures.style import ONE_COLUMN_MM, rendered, styled
from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.results_table import escaped
from haptigraph.analysis.study.traces import Traces
from haptigraph.figures import Figure

__all__ = ["Drawn", "draw_figures", "figures", "figures_tex"]

BOXES = "Boxes: quartiles; whiskers: at most 1.5 times the interquartile range; points: participants."
COLORS = "Background colours indicate the states."
CAPTIONS = {
    "rainclouds": f"The primary measures by condition. {BOXES} {{lines}}Beside them: Gaussian kernel density "
    f"within the range of the values, from {MIN_DENSITY_N} participants on, on one scale per panel.",
    "state_times": f"Time in each surgical state by condition. {BOXES} {COLORS}",
    "state_sequence": "Order of surgical states by condition: transitions per run; width shows frequency. "
    "Solid: in at least half of the runs; dashed: in fewer. Transitions below "
    f"{MIN_RATE:g} per run are not drawn, except from and to retinal contact.",
    "alignment": "Theta from entry to hit by condition: median and interquartile range of participants.",
    "depth_theta": "Distance to the retina against theta by condition. Thin: runs; thick: median of the "
    f"participants over normalised time. {COLORS}",
    "learning": "Learning over the session: trials by the position of their condition. Thin: participants; "
    f"thick: median of {MIN_MEDIAN_N} or more, with bars from the lower to the upper quartile, which are no "
    "confidence interval.",
    "questionnaires": f"Scores of further questionnaires by condition. {BOXES}",
}


class Drawn(Struct, frozen=True):
    """A figure as files."""

    name: str
    caption: str
    width_mm: float
    formats: dict[str, bytes]


def figures(results: StudyResults, traces: Traces, note: str) -> dict[str, Figure]:
    """Return the figures by name; those without data are left out. Call it within `styled`."""
    drawn = {
        "rainclouds": raincloud_figure(results, note),
        "state_times": box_figure(results, note),
        "state_sequence": sequence_figure(results, note),
        "alignment": alignment_figure(traces, results.titles, note),
        "depth_theta": cone_figure(traces, results.titles, note),
        "learning": learning_figure(results, note),
        "questionnaires": questionnaire_figure(results, note),
    }
    return {name: figure for name, figure in drawn.items() if figure is not None}


def draw_figures(results: StudyResults, traces: Traces, note: str) -> list[Drawn]:
    """Draw the figures of a report.

    Args:
        results: The results.
        traces: Of the analysed runs.
        note: A mark in every figure, such as that the data are simulated; may be empty.
    """
    lines = "Lines join the values of a participant. " if results.is_within else ""
    with styled():
        return [
            Drawn(
                name,
                CAPTIONS[name].format(lines=lines),
                round(25.4 * figure.get_figwidth(), 3),
                rendered(figure),
            )
            for name, figure in figures(results, traces, note).items()
        ]


def figures_tex(drawn: Sequence[Drawn], note: str) -> str:
    """Return LaTeX that includes the PDF files at their size, with captions."""
    parts = []
    for each in drawn:
        environment = "figure" if each.width_mm <= ONE_COLUMN_MM else "figure*"
        caption = f"{note}: {each.caption}" if note else each.caption
        parts += [
            rf"\begin{{{environment}}}[t]",
            r"\centering",
            rf"\includegraphics[width={each.width_mm:g}mm]{{figures/{each.name}.pdf}}",
            rf"\caption{{{escaped(caption)}}}",
            rf"\label{{fig:{each.name}}}",
            rf"\end{{{environment}}}",
            "",
        ]
    return "\n".join(parts)
