"""Two checkouts side by side: whether they compute the same numbers to the last digit, and which is faster.

`python benchmarks/compare_commits.py numbers BEFORE` scores the shared clips and 66 simulated scenes and runs
the golden recordings again, with either checkout. It lists the keys that were only renamed, and exits with 1
if a number differs. `... speed BEFORE [PAIRS]` runs what `make bench` runs, in turn, and prints the median
ratio of every figure. BEFORE is a checkout that `make setup` has made ready, as this one must be.
"""

import json
import re
import subprocess
import sys
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from mcap.reader import make_reader

HERE = Path(__file__).parents[1]
CLIPS = ("A_easy", "B_dark")
RENAMED = {"tip_deviation_mm": "tip_sd_mm", "theta_deviation_deg": "theta_sd_deg"}
COMPARED = ("/capture", "/observation", "/graph", "/state", "/command")
PROCEDURES = {
    "membrane_peeling": "membrane_peeling",
    "injection_with_phases": "subretinal_injection_phases",
    "ioct_approach": "subretinal_injection_ioct",
    "laser_photocoagulation": "laser_photocoagulation",
    "vein_cannulation": "vein_cannulation",
}
"""Of golden recordings, where it is not the usual one."""
BENCHMARKS = (
    ("loop.py",),
    ("perception.py",),
    ("bscan.py", "speed"),
    ("bscan.py", "speed", "--perceiver", "segmentation"),
    ("inference.py",),
)
FIGURE = re.compile(r"^(.*?)\s+(\d+(?:\.\d+)?)\s(ms|us|s)\b")


def numbers(before: Path) -> bool:
    """Compare what both checkouts compute; return whether it is the same."""
    evaluations = [
        ("evaluate", str(clip))
        for name in CLIPS
        if (clip := HERE.parent / "shared" / "clips" / name).is_dir()
    ]
    alike = [
        said("haptigraph " + " ".join(command), evaluated(before, command), evaluated(HERE, command))
        for command in (*evaluations, ("evaluate", "--simulated", "66"))
    ]
    with TemporaryDirectory() as folder:
        for golden in sorted((HERE / "tests" / "replay" / "golden").glob("*.mcap")):
            runs = [replayed(checkout, golden, Path(folder)) for checkout in (before, HERE)]
            alike.append(said(f"{golden.stem}, {len(runs[0])} messages", *runs))
    return all(alike)


def evaluated(checkout: Path, command: tuple[str, ...]) -> Any:
    """Return the JSON that a checkout prints for a command."""
    result = subprocess.run(
        [checkout / ".venv/bin/haptigraph", *command, "--json"],
        cwd=checkout,
        check=True,
        capture_output=True,
        text=True,
    )
    return json.loads(result.stdout)


def replayed(checkout: Path, golden: Path, folder: Path) -> list[list[Any]]:
    """Run a checkout on a recording's images; return the messages of its own recording."""
    path = folder / "run.mcap"
    path.unlink(missing_ok=True)
    settings = (
        "--set",
        "run.realtime=false",
        "--set",
        f'run.procedure="{PROCEDURES.get(golden.stem, "subretinal_injection")}"',
    )
    command = [checkout / ".venv/bin/haptigraph", "run", golden, "--record", path, *settings]
    subprocess.run(command, cwd=checkout, check=True, capture_output=True)
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages(topics=COMPARED)
        return [[channel.topic, json.loads(message.data)] for _, channel, message in messages]


def said(what: str, before: Any, after: Any) -> bool:
    """Print whether two results are the same, but for renamed keys; return it."""
    renamed: set[str] = set()
    is_same = _renamed(before, renamed) == after
    keys = f" ({', '.join(f'{key} -> {RENAMED[key]}' for key in sorted(renamed))})" if renamed else ""
    print(f"{'same' if is_same else 'DIFFERENT':10}{what}{keys}", flush=True)
    return is_same


def _renamed(value: Any, found: set[str]) -> Any:
    if isinstance(value, dict):
        found |= value.keys() & RENAMED.keys()
        return {RENAMED.get(key, key): _renamed(item, found) for key, item in value.items()}
    return [_renamed(item, found) for item in value] if isinstance(value, list) else value


def speed(before: Path, pairs: int) -> None:
    """Run the benchmarks of both checkouts in turn; print the ratio of every figure."""
    shared = [checkout.parent / "shared" for checkout in (before, HERE)]
    if shared[0].is_dir() != shared[1].is_dir():  # loop.py would time other images in one than in the other
        raise SystemExit(f"{' and '.join(map(str, shared))}: both must be there, or neither")
    for benchmark in BENCHMARKS:
        runs = [[figures(checkout, benchmark) for checkout in (before, HERE)] for _ in range(pairs)]
        if len({len(figures_) for pair in runs for figures_ in pair}) > 1:
            raise SystemExit(f"{benchmark[0]} prints other figures in one checkout than in the other")
        print(f"{' '.join(benchmark)}, {pairs} pairs{'before':>34}{'after':>10}{'after / before':>17}")
        for number, (label, _, unit) in enumerate(runs[0][1]):
            values = [[figures_[number][1] for figures_ in pair] for pair in runs]
            old, new = (median(column) for column in zip(*values, strict=True))
            ratio = median(after / first for first, after in values if first)
            print(f"  {label:44}{old:8.3f} {unit}{new:8.3f} {unit}{ratio:14.3f}", flush=True)


def figures(checkout: Path, benchmark: tuple[str, ...]) -> list[tuple[str, float, str]]:
    """Run one benchmark of a checkout; return label, value and unit of the first figure in each line."""
    script, *arguments = benchmark
    result = subprocess.run(
        [checkout / ".venv/bin/python", f"benchmarks/{script}", *arguments],
        cwd=checkout,
        check=True,
        capture_output=True,
        text=True,
    )
    found = (FIGURE.match(line) for line in result.stdout.splitlines())
    return [(match[1].strip(), float(match[2]), match[3]) for match in found if match]


def main() -> int:
    """Compare this checkout with another."""
    if len(sys.argv) < 3 or sys.argv[1] not in ("numbers", "speed"):
        raise SystemExit(__doc__)
    before = Path(sys.argv[2]).resolve()
    if sys.argv[1] == "numbers":
        return 0 if numbers(before) else 1
    speed(before, int(sys.argv[3]) if len(sys.argv) > 3 else 10)
    return 0


if __name__ == "__main__":
    sys.exit(main())
