"""Simulated operators with no, binary and continuous touch, or with forces: trials (CSV), tables, a figure.

`python benchmarks/touch_comparison.py` updates docs/explanation/simulated_comparison.md and its figure;
--output FOLDER writes to a folder instead. Every seed draws other operators, targets and noise. Takes a
minute per seed on one core, with forces four; far longer on rendered images (--perceiver tracker).
"""

import argparse
import csv
import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from msgspec import Struct
from touch_trials import (
    MEASURES,
    PairedTest,
    TouchTrial,
    by_seed,
    compare_touch,
    paired_tests,
    participant_values,
)

from haptigraph.commands.terminal import progress_bar
from haptigraph.study.simulated.ground_truth import GROUND_TRUTH, OLD_NAMES
from haptigraph.study.simulated.participant import TRAITS, Variation
from haptigraph.study.simulated.rehearsal import FORCES, SHIPPED, Condition

if TYPE_CHECKING:
    from matplotlib.axes import Axes


VARIATIONS = (
    Variation("as drawn"),
    Variation("visual angle SD and bias times 4", {"glance_sd_deg": 4, "visual_bias_sd_deg": 4}),
    Variation("visual angle SD and bias times 1/4", {"glance_sd_deg": 0.25, "visual_bias_sd_deg": 0.25}),
    Variation("no immediate alignment", values={"align_share": 0.0}),
    Variation("full immediate alignment", values={"align_share": 1.0}),
    Variation("half the attention to haptic cues", {"attention_probability": 0.5}),
    Variation("reaction to haptic cues 0.5 s later", values={"dual_task_delay_s": 0.63}),
    Variation("Weber fraction times 1/4", {"weber_fraction": 0.25}),
    Variation("twice the speed", {"pace_mm_s": 2, "pace_deg_s": 2}),
    Variation("four times the turning speed", {"pace_deg_s": 4}),
    Variation("no tremor", values={"tremor_mm": 0.0}),
)
"""Modifications of the operators, for a sensitivity analysis."""
HYSTERESIS = Condition("binary", "subretinal_injection_steady")
VARIED = ("theta_deg", "completion_s", "changes_per_min")
SEEDS = (1, 2, 3, 4, 5)
COLORS = ("#8a8a8a", "#e08a2e", "#2f6fb3", "#3f8f4f")
SHOWN = ("theta_deg", "completion_s", "near_misaligned_s", "far_aligned_s", "vibrating_s")


def write_trials(rows: Sequence[Struct], path: str | Path) -> None:
    """Write one line per trial, or per mean, with a header."""
    with Path(path).open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(rows[0].__struct_fields__)
        for row in rows:
            writer.writerow([_cell(getattr(row, name)) for name in row.__struct_fields__])


class VariedMeans(Struct, frozen=True):
    """Means over the operators of one seed under one variation and condition."""

    variation: str
    seed: int
    condition: str
    theta_deg: float
    completion_s: float
    changes_per_min: float


def results_table(rows: Sequence[TouchTrial]) -> str:
    """Return means and standard deviations over participants, a row per measure, as Markdown.

    With several seeds, both are ranges over the seeds.
    """
    conditions, seeds = _conditions(rows), by_seed(rows)
    lines = [_line(["simulated operators", *conditions]), _line(["---"] * (len(conditions) + 1))]
    for measure, (title, unit, digits) in MEASURES.items():
        if measure == "force_n" and not any(row.force_n for row in rows):
            continue
        cells = []
        for condition in conditions:
            values = [participant_values(part, measure, condition) for part in seeds.values()]
            means = span([float(np.mean(one)) for one in values], digits)
            sds = span([float(np.std(one, ddof=1)) for one in values], digits)
            cells.append(f"{means} (SD {sds})")
        lines.append(_line([f"{title} ({unit})", *cells]))
    missed = [str(sum(not row.hit for row in rows if row.condition == condition)) for condition in conditions]
    lines.append(_line(["Trials without a hit", *missed]))
    return "\n".join(lines)


def tests_table(tests: Sequence[Sequence[PairedTest]]) -> str:
    """Return the tests of every seed, a row each, as Markdown; figures are ranges over the seeds."""
    head = ["measure", "compared", "mean difference", "rank-biserial r", "p (Holm)", "seeds with p < 0.05"]
    lines = [_line(head), _line(["---"] * len(head))]
    for same in zip(*tests, strict=True):
        title, unit, digits = MEASURES[same[0].measure]
        difference = f"{span([test.mean_difference for test in same], digits, '+')} {unit}"
        p = sorted(test.holm_p for test in same)
        p_text = p_value(p[0]) if p_value(p[0]) == p_value(p[-1]) else f"{p_value(p[0])} to {p_value(p[-1])}"
        count = f"{sum(test.holm_p < 0.05 for test in same)} of {len(same)}"
        effect = span([test.effect for test in same], 2, "+")
        lines.append(_line([title, f"{same[0].first} → {same[0].second}", difference, effect, p_text, count]))
    return "\n".join(lines)


def varied_means(rows: Sequence[TouchTrial], label: str) -> list[VariedMeans]:
    """Return the means of every seed and condition under a variation."""
    return [
        VariedMeans(
            label,
            seed,
            condition,
            *(float(np.mean(participant_values(part, measure, condition))) for measure in VARIED),
        )
        for seed, part in by_seed(rows).items()
        for condition in _conditions(part)
    ]


def variations_table(means: Sequence[VariedMeans]) -> str:
    """Return theta, completion time and pattern changes under each variation, as ranges over the seeds.

    The last column is the difference of completion times, continuous minus binary.
    """
    conditions = [condition.name for condition in SHIPPED]
    head = ["simulated operators", *conditions, "continuous - binary (s)"]
    lines = [_line(head), _line(["---"] * len(head))]
    for label in dict.fromkeys(each.variation for each in means):
        parts = {
            name: [each for each in means if (each.variation, each.condition) == (label, name)]
            for name in conditions
        }
        cells = [
            " / ".join(span([getattr(each, name) for each in part], MEASURES[name][2]) for name in VARIED)
            for part in parts.values()
        ]
        pairs = zip(parts["binary"], parts["continuous"], strict=False)
        differences = [second.completion_s - first.completion_s for first, second in pairs]
        lines.append(_line([label, *cells, span(differences, 2, "+")]))
    return "\n".join(lines)


def span(values: Sequence[float], digits: int, sign: str = "") -> str:
    """Return the smallest and the largest of some values as text; "-" if there are none."""
    if not values:
        return "-"
    low, high = (f"{value:{sign}.{digits}f}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def traits_table() -> str:
    """Return every parameter of a simulated operator with its source, as Markdown."""
    lines = [_line(["parameter", "description", "unit", "distribution", "source"]), _line(["---"] * 5)]
    for name, trait in TRAITS.items():
        lines.append(_line([f"`{name}`", trait.description, trait.unit, trait.spread, trait.source]))
    return "\n".join(lines)


def touch_figure(rows: Sequence[TouchTrial], output: str | Path) -> None:
    """Draw a panel per measure, with a line per simulated operator over the conditions, and the means."""
    conditions = _conditions(rows)
    has_force = any(row.force_n for row in rows)
    figure = Figure(figsize=(11, 6.6), layout="constrained")
    shown = (*SHOWN, "force_n" if has_force else "changes_per_min")
    for axes, measure in zip(figure.subplots(2, 3).flat, shown, strict=True):
        _draw(axes, rows, measure, conditions)
    first = rows[0]
    people, seeds = len({row.participant for row in rows}), sorted({row.seed for row in rows})
    trials = len({row.repetition for row in rows})
    is_truth = OLD_NAMES.get(first.perceiver, first.perceiver) == GROUND_TRUTH
    perception = "ground truth with the tracker's noise" if is_truth else first.perceiver
    figure.suptitle(
        f"Simulated operators, not people: N = {people} per seed, {trials} trials per condition, "
        f"seeds {', '.join(map(str, seeds))}\n"
        f"perception: {perception}; lines: operators, bars: means"
    )
    figure.savefig(output, dpi=110)


def _draw(axes: "Axes", rows: Sequence[TouchTrial], measure: str, conditions: Sequence[str]) -> None:
    title, unit, _ = MEASURES[measure]
    values = np.array([participant_values(rows, measure, condition) for condition in conditions])
    places = np.arange(len(conditions))
    axes.plot(places, values, color="#b5b5b5", linewidth=0.8, zorder=1)
    for place, row, color in zip(places, values, COLORS, strict=False):
        axes.scatter(np.full(len(row), place), row, s=16, color=color, edgecolor="none", zorder=2)
        axes.plot([place - 0.22, place + 0.22], [row.mean()] * 2, color=color, linewidth=3.5, zorder=3)
    axes.set(title=title, ylabel=unit, xlim=(-0.5, len(conditions) - 0.5))
    axes.set_ylim(bottom=0)
    axes.set_xticks(places, labels=conditions)
    axes.grid(axis="y", color="#e4e4e4", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _conditions(rows: Sequence[TouchTrial]) -> list[str]:
    return list(dict.fromkeys(row.condition for row in rows))


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _cell(value: object) -> str:
    return str(int(value)) if isinstance(value, bool) else str(value)


def p_value(value: float) -> str:
    """Return a p-value as text."""
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


DOCS = Path(__file__).parents[1] / "docs"
PAGES = DOCS / "explanation"
NAME = "simulated_comparison"


def main() -> None:
    """Simulate, test, write, and print the speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--participants", type=int, default=16)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS, help="each draws other operators")
    parser.add_argument(
        "--perceiver",
        type=lambda name: OLD_NAMES.get(name, name),
        default=GROUND_TRUTH,
        help="ground-truth (with noise), tracker or threshold",
    )
    parser.add_argument("--vary", action="store_true", help="simulate under modifications of the operators")
    parser.add_argument("--forces", action="store_true", help="compare none, vibration, force, and both")
    parser.add_argument("--output", type=Path, help="a folder; docs/explanation/ if not given")
    given = parser.parse_args()
    if given.vary:
        vary(given)
        return
    conditions, name = (FORCES, f"{NAME}_forces") if given.forces else (SHIPPED, NAME)
    start_s, start_cpu_s = time.perf_counter(), time.process_time()
    with progress_bar() as progress:
        rows = [
            row
            for seed in given.seeds
            for row in compare_touch(
                given.participants,
                given.repetitions,
                seed,
                conditions=conditions,
                perceiver=given.perceiver,
                progress=progress,
            )
        ]
    wall_s, cpu_s = time.perf_counter() - start_s, time.process_time() - start_cpu_s
    simulated_s = sum(row.completion_s for row in rows)
    prefix = "forces " if given.forces else ""
    tables = {
        f"{prefix}results": results_table(rows),
        f"{prefix}tests": tests_table([paired_tests(part) for part in by_seed(rows).values()]),
    }
    folder = given.output or PAGES
    folder.mkdir(parents=True, exist_ok=True)
    pictures = folder if given.output else DOCS / "images"
    write_trials(rows, folder / f"{name}.csv")
    touch_figure(rows, pictures / f"{name}.png")
    if given.output is None:
        renew(PAGES / f"{NAME}.md", {**tables, "traits": traits_table()})
    for table in tables.values():
        print(table, end="\n\n")
    print(
        f"{len(rows)} trials, {simulated_s / 60:.1f} simulated minutes in {wall_s:.0f} s "
        f"({cpu_s:.0f} s of CPU time): {simulated_s / wall_s:.0f} simulated minutes per minute, "
        f"{simulated_s / cpu_s:.0f} per minute of CPU time"
    )


def vary(given: argparse.Namespace) -> None:
    """Simulate all variations of the operators, and hysteresis."""
    means: list[VariedMeans] = []
    cases = [(one.label, one, SHIPPED) for one in VARIATIONS]
    for label, change, conditions in [*cases, ("with hysteresis", VARIATIONS[0], (HYSTERESIS,))]:
        for seed in given.seeds:
            rows = compare_touch(
                given.participants,
                given.repetitions,
                seed,
                conditions=conditions,
                perceiver=given.perceiver,
                change=change,
            )
            means += varied_means(rows, label)
    folder = given.output or PAGES
    folder.mkdir(parents=True, exist_ok=True)
    write_trials(means, folder / f"{NAME}_variations.csv")
    table = variations_table(means)
    if given.output is None:
        renew(PAGES / f"{NAME}.md", {"variations": table})
    print(table)


def renew(page: Path, tables: dict[str, str], command: str = "make compare-touch") -> None:
    """Replace the tables between their marks in a page; the marks name the generating command."""
    text = page.read_text(encoding="utf-8")
    for name, table in tables.items():
        marks = re.compile(rf"(<!-- {name}: made by {command} -->\n).*?(<!-- end -->)", re.DOTALL)
        text, found = marks.subn(lambda match, table=table: f"{match[1]}\n{table}\n\n{match[2]}", text)
        if found != 1:
            raise SystemExit(f"{page}: expected one mark for {name!r}, found {found}")
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
