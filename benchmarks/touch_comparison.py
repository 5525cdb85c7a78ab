"""Simulated operators with no touch, binary and continuous touch: trials (CSV), tables (Markdown), a figure.

`python benchmarks/touch_comparison.py` renews docs/simulated_comparison.md and what it shows; with --output
FOLDER all goes there instead. A minute on one core; far longer with --perceiver tracker, which gets drawn
images.
"""

import argparse
import re
import time
from pathlib import Path

from haptigraph.analysis.touch_comparison import compare_touch, paired_tests
from haptigraph.analysis.touch_report import (
    results_table,
    tests_table,
    touch_figure,
    traits_table,
    variations_table,
    write_trials,
)
from haptigraph.terminal import progress_bar

DOCS = Path(__file__).parents[1] / "docs"
NAME = "simulated_comparison"


def main() -> None:
    """Play, test, write, and say how fast it went."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--participants", type=int, default=16)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--perceiver", default="known", help="known (the truth with noise), tracker or threshold"
    )
    parser.add_argument("--vary", action="store_true", help="how it depends on what the operators are like")
    parser.add_argument("--output", type=Path, help="a folder; docs/ if not given")
    given = parser.parse_args()
    if given.vary:
        vary(given)
        return
    begun_s, begun_cpu_s = time.perf_counter(), time.process_time()
    with progress_bar() as progress:
        rows = compare_touch(
            given.participants, given.repetitions, given.seed, perceiver=given.perceiver, progress=progress
        )
    wall_s, cpu_s = time.perf_counter() - begun_s, time.process_time() - begun_cpu_s
    simulated_s = sum(row.completion_s for row in rows)
    tables = {
        "results": results_table(rows),
        "tests": tests_table(paired_tests(rows)),
        "traits": traits_table(),
    }
    folder = given.output or DOCS
    folder.mkdir(parents=True, exist_ok=True)
    pictures = folder if given.output else DOCS / "images"
    write_trials(rows, folder / f"{NAME}.csv")
    touch_figure(rows, pictures / f"{NAME}.png")
    if given.output is None:
        renew(DOCS / f"{NAME}.md", tables)
    for title, table in tables.items():
        if title != "traits":
            print(table, end="\n\n")
    print(
        f"{len(rows)} trials, {simulated_s / 60:.1f} simulated minutes in {wall_s:.0f} s "
        f"({cpu_s:.0f} s of one core): {simulated_s / wall_s:.0f} simulated minutes per minute, "
        f"{simulated_s / cpu_s:.0f} per minute of core"
    )


def vary(given: argparse.Namespace) -> None:
    """Play everything again with operators who are other than drawn."""
    table = variations_table(
        lambda variation: compare_touch(
            given.participants, given.repetitions, given.seed, perceiver=given.perceiver, change=variation
        )
    )
    if given.output is None:
        renew(DOCS / f"{NAME}.md", {"variations": table})
    print(table)


def renew(page: Path, tables: dict[str, str], command: str = "make compare-touch") -> None:
    """Put tables between their marks in a page; the marks name the command that makes them."""
    text = page.read_text(encoding="utf-8")
    for name, table in tables.items():
        marks = re.compile(rf"(<!-- {name}: made by {command} -->\n).*?(<!-- end -->)", re.DOTALL)
        text, found = marks.subn(lambda match, table=table: f"{match[1]}\n{table}\n\n{match[2]}", text)
        if found != 1:
            raise SystemExit(f"{page}: expected one mark for {name!r}, found {found}")
    page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
