"""The result tables, the paper's first, in LaTeX and Markdown and for the page."""

import math
from collections.abc import Sequence
from itertools import combinations

from msgspec import Struct

from haptigraph.analysis.study.preregistered.families import Family
from haptigraph.analysis.study.preregistered.hypotheses import sentence
from haptigraph.analysis.study.quantities import words
from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.statistics.comparison import Comparison, Sample
from haptigraph.analysis.study.statistics.effects import Effect
from haptigraph.analysis.study.statistics.equivalence import Equivalence
from haptigraph.analysis.study.statistics.exact import smallest_p
from haptigraph.analysis.study.statistics.hit_rate import HitRate
from haptigraph.analysis.study.statistics.shift import Shift
from haptigraph.analysis.words import counted

__all__ = [
    "NONE", "Table", "escaped", "hypothesis_table", "latex", "markdown", "mean_text", "number",
    "p_text", "result_tables",
]  # fmt: skip

NONE = "-"
LEVEL = 0.05  # of the intervals, which have 95 %


class Table(Struct, frozen=True):
    """A table with formatted cells."""

    caption: str
    head: list[str]
    rows: list[list[str]]
    label: str = ""


def number(value: float, decimals: int = 3) -> str:
    """Format a number; a dash stands for NaN and infinity."""
    return f"{value:z.{decimals}f}" if math.isfinite(value) else NONE


def p_text(p: float) -> str:
    """Format a p-value."""
    if not math.isfinite(p):
        return NONE
    return "<0.001" if p < 0.0005 else f"{p:.3f}"


def result_tables(results: StudyResults) -> list[Table]:
    """Return a table per family and pair of conditions, the paper's first; then equivalence, hit rates."""
    tables = []
    for family in results.families:
        for pair in combinations(results.conditions, 2):
            rows = [
                [*_row(comparison, holm, results.plan.alpha), *_status(results, comparison)]
                for comparison, holm in zip(family.comparisons, family.holm, strict=True)
                if (comparison.first, comparison.second) == pair
            ]
            if rows:
                tables.append(_table(results, family, pair, rows))
    return [*tables, *_equivalence_table(results), *_hit_table(results)]


def _table(results: StudyResults, family: Family, pair: tuple[str, str], rows: list[list[str]]) -> Table:
    over = counted(family.explored, "exploratory test" if results.hypotheses else "test")
    if results.hypotheses:
        over = f"the preregistered hypotheses, and over {over}"
    apart = "; p (Holm) is corrected apart for confirmatory and exploratory tests" * bool(results.hypotheses)
    marks = f"* p < {results.plan.alpha:g}; † also after Holm's correction over {over}{apart}"
    caption = f"{words(family.about)}, mean ± SD over participants. {marks}."
    estimates = ["Difference [95 % CI]", "r [95 % CI]"]
    label = f"{family.name}_{pair[0]}_{pair[1]}"
    status = ["Test"] if results.hypotheses else []
    head = ["Metric", *map(results.title_of, pair), "n", "p", "p (Holm)", *estimates, *status]
    return Table(f"{caption} Difference: Hodges-Lehmann. A dash: too few values.", head, rows, label)


def _status(results: StudyResults, comparison: Comparison) -> list[str]:
    if not results.hypotheses:
        return []
    return ["confirmatory" if results.is_confirmatory(comparison) else "exploratory"]


def hypothesis_table(results: StudyResults) -> list[Table]:
    """Return the table of the preregistered hypotheses; empty without any."""
    if not results.hypotheses:
        return []
    rows = [
        [
            sentence(each.hypothesis, results.quantities[each.hypothesis.measure], results.titles),
            "primary" if each.is_primary else "other",
            f"{each.bounds[0]:g} to {each.bounds[1]:g}" if each.bounds else "",
            p_text(each.p),
            p_text(each.holm_p),
            {True: "yes", False: "no", None: f"not tested: {each.why_untested}"}[each.is_supported],
        ]
        for each in results.hypotheses
    ]
    head = ["Hypothesis", "Family", "Bounds", "p", "p (Holm)", "Supported"]
    caption = (
        f"Preregistered hypotheses (confirmatory), at the level {results.plan.alpha:g} after Holm's "
        "correction within each family."
    )
    return [Table(caption, head, rows, "hypotheses")]


def _equivalence_table(results: StudyResults) -> list[Table]:
    rows = [
        [
            each.quantity.title,
            ", ".join(map(results.title_of, (each.first, each.second))),
            f"{each.equivalence.bound_low:g} to {each.equivalence.bound_high:g}",
            _interval(each.equivalence, each.quantity.decimals),
            p_text(each.equivalence.p),
            "yes" if each.equivalence.is_shown else "no",
        ]
        for family in results.families
        for each in family.comparisons
        if each.equivalence is not None
    ]
    alpha = results.plan.alpha
    head = [
        "Metric",
        "Conditions",
        "Bounds",
        f"Difference [{100 * (1 - 2 * alpha):g} % CI]",
        "p",
        "Equivalent",
    ]
    caption = f"Equivalence within preregistered bounds: two one-sided rank tests, each at {alpha:g}."
    return [Table(caption, head, rows, "equivalence")] if rows else []


def _hit_table(results: StudyResults) -> list[Table]:
    rows = [
        [
            ", ".join(map(results.title_of, (each.first, each.second))),
            f"{each.hits.hits_first}/{each.hits.n_first}",
            f"{each.hits.hits_second}/{each.hits.n_second}",
            p_text(each.hits.p),
            _odds(each.hits, paired=results.is_within),
            f"{p_text(each.worst_rank.p)}, r {_interval(each.effect, 2)}",
        ]
        for each in results.timeouts
    ]
    caption = (
        "Participants who hit the target in all their runs, and completion time with runs without a hit "
        "ranked last (sensitivity analysis; p-values are not corrected)."
    )
    head = ["Conditions", "First", "Second", "p", "Odds ratio [95 % CI]", "Completion time, p"]
    return [Table(caption, head, rows, "hit_rate")] if rows else []


def _row(comparison: Comparison, holm: float, alpha: float) -> list[str]:
    decimals = comparison.quantity.decimals
    first, second = (mean_text(sample, decimals) for sample in comparison.samples)
    p = comparison.test.p
    mark = ("*" if p < alpha else "") + ("†" if holm < alpha else "")
    estimates = [_interval(comparison.shift, decimals), _interval(comparison.effect, 2)]
    sizes = "/".join(str(size) for size in sorted({sample.n for sample in comparison.samples}))
    return [comparison.quantity.title, first, second, sizes, p_text(p) + mark, p_text(holm), *estimates]


def _interval(found: Effect | Shift | Equivalence, decimals: int) -> str:
    """Return an estimate with its limits; without limits a dash follows."""
    value = number(found.r if isinstance(found, Effect) else found.estimate, decimals)
    if not math.isfinite(found.low):
        return f"{value} [{NONE}]"
    return f"{value} [{number(found.low, decimals)}, {number(found.high, decimals)}]"


def _odds(hits: HitRate, *, paired: bool) -> str:
    """Return an odds ratio; without limits where no rate of so few participants could be significant."""
    if smallest_p(hits.n_first, hits.n_second, paired=paired) >= LEVEL:
        return f"{_limit(hits.odds_ratio)} [{NONE}]"
    return f"{_limit(hits.odds_ratio)} [{_limit(hits.low)}, {_limit(hits.high)}]"


def _limit(odds: float) -> str:
    return "∞" if odds == math.inf else number(odds, 2)


def mean_text(sample: Sample, decimals: int) -> str:
    """Format mean ± SD; one value has no SD."""
    sd = f" ± {number(sample.sd, decimals)}" if math.isfinite(sample.sd) else ""
    return f"{number(sample.mean, decimals)}{sd}"


def markdown(tables: Sequence[Table], note: str = "", remarks: Sequence[str] = ()) -> str:
    """Return tables in Markdown, after a note and before remarks."""
    parts = [f"**{note}**\n"] if note else []
    for table in tables:
        lines = [table.head, ["---", *["---:"] * (len(table.head) - 1)], *table.rows]
        body = "\n".join(
            "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
        )
        parts.append(f"{table.caption}\n\n{body}\n")
    return "\n".join([*parts, *(f"{remark}\n" for remark in remarks)])


def latex(tables: Sequence[Table], note: str = "") -> str:
    """Return tables in LaTeX with booktabs, in the style of the paper."""
    return "\n".join(_latex(table, note) for table in tables)


def _latex(table: Table, note: str) -> str:
    caption = f"{note}: {table.caption}" if note else table.caption
    lines = [
        r"\begin{table}[t]",
        r"\centering",
        rf"\caption{{{escaped(caption)}}}",
        rf"\label{{tab:{_plain(table.label)}}}",
        rf"\begin{{tabular}}{{l{'c' * (len(table.head) - 1)}}}",
        r"\toprule",
        " & ".join(rf"\textbf{{{escaped(cell)}}}" for cell in table.head) + r" \\",
        r"\midrule",
        *(" & ".join(map(escaped, row)) + r" \\" for row in table.rows),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
        "",
    ]
    return "\n".join(lines)


def _plain(label: str) -> str:
    return "".join(letter if letter.isalnum() or letter == "_" else "_" for letter in label)


TEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "$": r"\$", "{": r"\{",
    "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "±": r"$\pm$", "°": r"$^\circ$",
    "†": r"$^\dagger$", "*": "$^*$", "²": "$^2$", "∞": r"$\infty$", "<": "$<$", ">": "$>$",
}  # fmt: skip


def escaped(text: str) -> str:
    """Return a text for LaTeX."""
    return "".join(TEX.get(letter, letter) for letter in text)
