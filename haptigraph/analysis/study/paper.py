"""The paper's published results beside those of a study that has the paper's conditions."""

from importlib import resources

import msgspec
from msgspec import Struct, field

from haptigraph.analysis.study.quantities import QUANTITIES
from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.results_table import LEVEL, NONE, Table, mean_text, number, p_text
from haptigraph.analysis.study.runs import condition_values
from haptigraph.analysis.study.statistics.comparison import Sample
from haptigraph.analysis.study.statistics.exact import smallest_p
from haptigraph.analysis.study.statistics.sensitivity import paired_t

__all__ = ["Beside", "beside_paper"]

HERE = "this study"
NOT_EVIDENCE = (
    "Simulated participants are no evidence about people: neither agreement with the paper nor a difference "
    "from it says anything about haptic feedback. They obey vibration, and answer questionnaires at random."
)
OTHER_STUDY = (
    "Two studies differ in participants, robot and pictures: a difference between them has more causes than "
    "chance."
)


class _Measure(Struct, frozen=True):
    name: str
    mean: tuple[float, float]
    sd: tuple[float, float]
    p: float


class _Statement(Struct, frozen=True):
    name: str
    label: str
    statistic: str
    text: tuple[str, str]
    p: str = NONE


class _PaperFigure(Struct, frozen=True):
    title: str
    here: str


class _Paper(Struct, frozen=True):
    citation: str
    participants: int
    conditions: tuple[str, str]
    measures: tuple[_Measure, ...] = field(name="measure")
    statements: tuple[_Statement, ...] = field(name="statement")
    figures: tuple[_PaperFigure, ...] = field(name="figure")


class Beside(Struct, frozen=True):
    """A study beside the paper."""

    table: Table
    notes: list[str]


def beside_paper(results: StudyResults, *, simulated: bool) -> Beside | None:
    """Return the paper's results beside the study's; None if it lacks the paper's conditions or design."""
    data = (resources.files("haptigraph.analysis.study") / "paper.toml").read_bytes()
    paper = msgspec.toml.decode(data, type=_Paper)
    if not results.is_within or not set(paper.conditions) <= set(results.conditions):
        return None
    rows = [row for measure in paper.measures for row in _measured(paper, measure, results)]
    rows += [row for statement in paper.statements for row in _stated(paper, statement, results)]
    rows = [[cell if cell != HERE or not simulated else "simulated" for cell in row] for row in rows]
    head = ["Metric", "Study", "n", *map(results.title_of, paper.conditions), "Difference [95 % CI]", "p"]
    caption = (
        "The paper's results beside this study's: mean ± SD over participants, mean difference with "
        "Student's 95 % interval of paired differences, p of the Wilcoxon signed-rank test, uncorrected. The "
        f"paper has no intervals. Paper: {paper.citation}."
    )
    figures = "; ".join(f"“{figure.title}”: {figure.here}" for figure in paper.figures)
    notes = [NOT_EVIDENCE if simulated else OTHER_STUDY, f"The paper's figures and those here: {figures}."]
    return Beside(Table(caption, head, rows, "beside_paper"), notes)


def _measured(paper: _Paper, measure: _Measure, results: StudyResults) -> list[list[str]]:
    quantity = next(each for each in QUANTITIES if each.name == measure.name)
    decimals = quantity.decimals
    published = [
        f"{mean:.{decimals}f} ± {sd:.{decimals}f}" for mean, sd in zip(measure.mean, measure.sd, strict=True)
    ]
    change = _signed(measure.mean[1] - measure.mean[0], decimals)
    first = [quantity.title, "paper", str(paper.participants), *published, change, p_text(measure.p)]
    return [first, ["", HERE, *_here(paper, measure.name, decimals, results)]]


def _here(paper: _Paper, name: str, decimals: int, results: StudyResults) -> list[str]:
    """Return n, both conditions, the difference and p."""
    if name not in results.values:
        return ["0", *[NONE] * 4]
    values = condition_values(results.values[name], *paper.conditions, paired=True)
    cells = [mean_text(each, decimals) for each in map(Sample.of, values)]
    t, count = paired_t(*values), len(values[0])
    change, low, high = (_signed(value, decimals) for value in (t.difference, t.low, t.high))
    is_known = smallest_p(count, count, paired=True) < LEVEL
    limits = f"{low}, {high}" if is_known else NONE
    return [str(count), *cells, f"{change} [{limits}]", _p(name, paper, results)]


def _signed(value: float, decimals: int) -> str:
    return f"+{number(value, decimals)}" if value > 0 else number(value, decimals)


def _p(name: str, paper: _Paper, results: StudyResults) -> str:
    for family in results.families:
        for each in family.comparisons:
            if each.quantity.name == name and {each.first, each.second} == set(paper.conditions):
                return p_text(each.test.p)
    return NONE


def _stated(paper: _Paper, statement: _Statement, results: StudyResults) -> list[list[str]]:
    first = [statement.label, "paper", str(paper.participants), *statement.text, NONE, statement.p]
    if statement.name not in results.runs:
        return [first, ["", HERE, "0", *[NONE] * 4]]
    if statement.statistic == "sum":
        runs = results.runs.groupby("condition")[statement.name].sum()
        cells = [number(float(runs.get(condition, 0)), 0) for condition in paper.conditions]
        return [first, ["", HERE, str(results.participants), *cells, NONE, NONE]]
    values = condition_values(results.values[statement.name], *paper.conditions, paired=True)
    cells = [number(Sample.of(each).median, 1) for each in values]
    here = ["", HERE, str(len(values[0])), *cells, NONE, _p(statement.name, paper, results)]
    return [first, here]
