"""Ablation of tip and line: each number is doubled once and set to zero once, and clips are scored again.

`python benchmarks/ablation.py [FOLDER ...] [--only TEXT] [--jobs N] [--json-lines FILE]`. Every trial changes
one number in a copy of the package, compiles it if the number is in C, and runs `degraded.py` on the folders.
The file keeps each trial as soon as it is done, and a later call goes on from there; delete it after other
changes. A number that may be doubled and may be zero without an effect is a candidate for deletion, but only
scenes that it was not made for can show that.
"""

import argparse
import ast
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
from msgspec import Struct

ROOT = Path(__file__).parents[1]
PERCEPTION = Path("haptigraph/perception")
NEEDLE, NATIVE = PERCEPTION / "needle", PERCEPTION / "native"
SHARED = {"interface.c", "native.h", "rectify.c", "pixels.c", "median.c"}  # layouts and limits, no estimates
DEFINE = re.compile(r"^#define ([A-Z_0-9]+) +(-?\d+(?:\.\d+)?)f?\b", re.MULTILINE)
FACTORS = {"doubled": 2, "zero": 0}
TIMEOUT_S = 120
CACHE = ROOT / "build" / "degraded"
NO_EFFECT = 0.002  # of images: less than one in 500


class Number(Struct, frozen=True):
    """A number in a source file."""

    file: str
    """Relative to the repository."""
    name: str
    start: int
    """Of its text in the file, in characters."""
    text: str

    def times(self, factor: int) -> str:
        """Return its text multiplied by a factor, of the same type."""
        value = ast.literal_eval(self.text) * factor
        return str(value)


class Trial(Struct, frozen=True):
    """The scores with one number changed."""

    number: Number | None
    """None: nothing was changed."""
    change: str
    rows: list[dict[str, Any]]
    """Of all clips together, one per variant; empty if perception failed."""


def main() -> None:
    """Run what trials are left, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: python benchmarks/ablation.py tests/data/renderings --only tip_network",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", nargs="*", type=Path, help="a labelled clip, or a folder with some")
    parser.add_argument("--only", default="", metavar="TEXT", help="only files or names that contain it")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="trials at the same time")
    parser.add_argument("--json-lines", type=Path, default=ROOT / "build" / "ablation.jsonl", metavar="FILE")
    given = parser.parse_args()
    folders = [folder.resolve() for folder in given.folder]
    missing = [folder for folder in folders if not folder.is_dir()]
    if missing:
        print(f"ablation: {missing[0]} is no folder; give labelled clips", file=sys.stderr)
        raise SystemExit(2)
    given.json_lines.parent.mkdir(parents=True, exist_ok=True)
    done = recorded(given.json_lines)
    left = [
        (number, change)
        for number, change in planned()
        if key(number, change) not in done and given.only in key(number, change)
    ]
    with ThreadPoolExecutor(max(given.jobs, 1)) as pool, given.json_lines.open("ab") as output:
        for trial in pool.map(lambda each: run(*each, folders), left):
            done[key(trial.number, trial.change)] = trial
            output.write(msgspec.json.encode(trial) + b"\n")
            output.flush()
            print(f"{len(done)}: {key(trial.number, trial.change)}", file=sys.stderr)
    print(table(list(done.values())))


def planned() -> Iterator[tuple[Number | None, str]]:
    """Yield every trial, that without a change first."""
    yield None, "unchanged"
    for number in numbers(ROOT):
        for change in FACTORS:
            yield number, change


def key(number: Number | None, change: str) -> str:
    """Return what identifies a trial."""
    return f"{number.file}:{number.name} {change}" if number else change


def recorded(file: Path) -> dict[str, Trial]:
    """Return the trials in a file."""
    if not file.exists():
        return {}
    trials = [msgspec.json.decode(line, type=Trial) for line in file.read_bytes().splitlines()]
    return {key(trial.number, trial.change): trial for trial in trials}


def numbers(root: Path) -> list[Number]:
    """Return every number in a module's constants that tip or line depend on, and every #define in C."""
    found = []
    for path in sorted((root / NEEDLE).glob("*.py")):
        found += [each for each in in_python(path.read_text("utf-8"), str(path.relative_to(root)))]
    for path in sorted((root / NATIVE).glob("*.c")):
        if path.name not in SHARED:
            file, text = str(path.relative_to(root)), path.read_text("utf-8")
            found += [Number(file, at[1], at.start(2), at[2]) for at in DEFINE.finditer(text)]
    return found


def in_python(text: str, file: str) -> list[Number]:
    """Return the numbers of a module's constants."""
    lines, found = text.splitlines(keepends=True), []
    for statement in ast.parse(text).body:
        target = statement.targets[0] if isinstance(statement, ast.Assign) else None
        if not isinstance(statement, ast.Assign) or not isinstance(target, ast.Name | ast.Tuple):
            continue
        names = [ast.unparse(each) for each in target.elts] if isinstance(target, ast.Tuple) else [target.id]
        values = sorted(filter(is_number, ast.walk(statement.value)), key=lambda value: value.col_offset)
        for place, value in enumerate(values):
            name = names[place] if len(names) == len(values) else f"{names[0]}[{place}]"
            start = sum(map(len, lines[: value.lineno - 1])) + value.col_offset
            stop = start + value.end_col_offset - value.col_offset
            found.append(Number(file, name, start, text[start:stop]))
    return found


def is_number(node: ast.AST) -> bool:
    """Return whether a node is a number that is not zero."""
    return isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value != 0


def run(number: Number | None, change: str, folders: Sequence[Path]) -> Trial:
    """Score a copy of the package in which one number is changed."""
    with TemporaryDirectory() as folder:
        copy, scores = Path(folder), Path(folder, "scores.json")
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "haptigraph", copy / "haptigraph", ignore=ignored)
        if number is not None:
            path = copy / number.file
            text = path.read_text("utf-8")
            end = number.start + len(number.text)
            path.write_text(text[: number.start] + number.times(FACTORS[change]) + text[end:], "utf-8")
        library = copy / NATIVE / "native.library"
        is_done = number is None or number.file.endswith(".py") or compiled(copy, library)
        if is_done:
            script = ROOT / "benchmarks" / "degraded.py"
            command = [sys.executable, script, *folders, "--json", scores, "--cache", CACHE]
            environment = os.environ | {"PYTHONPATH": str(copy), "OMP_NUM_THREADS": "1"}
            try:
                subprocess.run(command, env=environment, capture_output=True, timeout=TIMEOUT_S, check=True)
            except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
                is_done = False
        rows = msgspec.json.decode(scores.read_bytes())["rows"] if is_done else []
    return Trial(number, change, [row for row in rows if row["clip"] == "all"])


def compiled(copy: Path, library: Path) -> bool:
    """Compile a copy's C sources, and return whether that worked."""
    shutil.copy(ROOT / "hatch_build.py", copy)
    command = [sys.executable, copy / "hatch_build.py", library]
    return subprocess.run(command, capture_output=True).returncode == 0


def table(trials: Sequence[Trial]) -> str:
    """Return a line per trial, least effect first: differences from the trial without a change."""
    plain = next((trial for trial in trials if trial.number is None), None)
    if plain is None or not plain.rows:
        return "ablation: nothing to compare with: the trial without a change is missing or failed"
    head = (
        f"{'number':58}{'change':9}{'known':>8}{'far':>8}{'states':>8}{'tip p95':>9}{'z p95':>8}{'missed':>7}"
    )
    lines, silent = [], 0
    for trial in trials:
        if trial.number is None:
            continue
        name = f"{Path(trial.number.file).name}:{trial.number.name} = {trial.number.text}"
        if not trial.rows:
            lines.append((9.0, f"{name:58}{trial.change:9}  perception fails"))
            continue
        known, far, states = (
            change_of(trial, plain, score) for score in ("tip_known_rate", "tip_far_rate", "state_agreement")
        )
        tip_px = mean(trial, lambda row: row["tip_error_px"]["p95"]) / mean(
            plain, lambda row: row["tip_error_px"]["p95"]
        )
        z = mean(trial, lambda row: row["tip_z"]["p95"]) / mean(plain, lambda row: row["tip_z"]["p95"])
        missed = sum(row["missed_contact_images"] for row in trial.rows)
        effect = max(abs(known), abs(far), abs(states), abs(tip_px - 1) / 10, abs(z - 1) / 10)
        silent += effect < NO_EFFECT
        lines.append(
            (
                effect,
                f"{name:58}{trial.change:9}{100 * known:+8.2f}{100 * far:+8.2f}{100 * states:+8.2f}"
                f"{tip_px:9.3f}{z:8.3f}{missed:7d}",
            )
        )
    ordered = [text for _, text in sorted(lines)]
    return "\n".join((head, *ordered, f"{silent} of {len(lines)} changes have next to no effect"))


def change_of(trial: Trial, plain: Trial, score: str) -> float:
    """Return by how much a score differs from that without a change, in the mean of all variants."""
    return mean(trial, lambda row: row[score]) - mean(plain, lambda row: row[score])


def mean(trial: Trial, score: Any) -> float:
    """Return the mean of a score over all variants; 0 where it has none."""
    return sum(score(row) or 0.0 for row in trial.rows) / len(trial.rows)


if __name__ == "__main__":
    main()
