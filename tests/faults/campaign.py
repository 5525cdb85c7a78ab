"""Draw faults at random against the real program, and print a table: trials, failures, worst silence, losses.

`make faults` runs it; its options are those of `--help`. The file of results keeps each trial as soon as it is
done, and a later call goes on from there. The exit code is 1 if a promise was broken.
"""

import argparse
import random
import shlex
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import msgspec
import trials
import trials_of_driver
import trials_of_force
import trials_of_input
import trials_of_robot
from damages import make_files
from trials import DATA, program

from haptigraph.analysis.evaluation.origin import new_origin
from haptigraph.analysis.evidence.campaign import FORMAT, Session, Trial, read_campaign

ROOT = Path(__file__).parents[2]
TRIALS = {  # of each kind, in a whole campaign
    "hung process": (120, trials.hung_process),
    "ended run": (120, trials.ended_run),
    "driver chip": (120, trials_of_driver.driver_chip),
    "driver chip, restarts": (60, trials_of_driver.restarts),
    "half-open connections": (60, trials.half_open_connections),
    "recover": (300, trials.recovered),
    "replay of a complete file": (200, trials.replayed_whole),
    "replay of a journal": (200, trials.replayed_journal),
    "meddled recording": (80, trials.meddled),
    "full disk": (60, trials.full_disk),
    "slow connection": (60, trials_of_input.slow_connection),
    "raw images over ROS 2": (60, trials_of_input.raw_images),
    "damaged file": (180, trials_of_input.damaged_file),
    "foreign requests": (60, trials_of_input.foreign_requests),
    "schemas and normal ends": (60, trials.schemas),
    "killed or hung robot process": (60, trials_of_robot.robot_processes),
    "force on the hand": (130, trials_of_force.forced_hand),
}
WITH_FILES = ("recover", "replay of a complete file", "replay of a journal", "damaged file")


def run_trial(kind: str, number: int, seed: int, files: Path) -> Trial:
    """Run one trial; the same seed draws the same faults."""
    _, function = TRIALS[kind]
    trial = partial(function, files=files) if kind in WITH_FILES else function
    folder = Path(tempfile.mkdtemp(prefix="haptigraph-faults-"))
    try:
        measured = trial(random.Random(f"{seed} {kind} {number}"), folder)
    except trials_of_input.Skipped as reason:
        return Trial(kind, number, skipped=str(reason))
    except Exception as error:  # whatever a trial meets is a result
        return Trial(kind, number, failure=f"{type(error).__name__}: {str(error)[:500]}")
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return Trial(kind, number, measured.what, silence_ms=measured.silence_ms, lost=measured.lost)


def make_samples(folder: Path) -> None:
    """Write the files that trials damage."""
    from studying import PROTOCOL

    program("run", f"phantom:{DATA / 'quick.toml'}", "--fast", "--record", folder / "run.mcap")
    make_files(folder / "run.mcap", folder)
    from haptigraph.sources.phantom import PhantomSource

    (folder / "registration.toml").write_text(PhantomSource(str(DATA / "quick.toml")).registration or "")
    (folder / "study.toml").write_text(PROTOCOL)
    shipped = ROOT / "haptigraph" / "procedures" / "subretinal_injection.toml"
    (folder / "procedure.toml").write_bytes(shipped.read_bytes())
    export_of(folder)


def export_of(folder: Path) -> None:
    """Write the export of a study with one participant."""
    from contextlib import closing

    from haptigraph.study.exchange.exporting import export_study
    from haptigraph.study.protocol import load_protocol
    from haptigraph.study.roster import Study
    from haptigraph.study.store import Store

    with closing(Store(folder / "study.db")) as store:
        Study(load_protocol(folder), store).enrol()
        export_study(store, "short", folder / "export")


def planned(scale: float, only: str, skip: str = "none") -> Iterator[tuple[str, int]]:
    """Yield kinds and numbers of all trials, mixed, so that an early end has some of each."""
    counts = {
        kind: max(round(count * scale), 1)
        for kind, (count, _) in TRIALS.items()
        if only in kind and skip not in kind
    }
    order = [
        ((number + 0.5) / count, kind, number) for kind, count in counts.items() for number in range(count)
    ]
    yield from ((kind, number) for _, kind, number in sorted(order))


def table(results: list[Trial]) -> str:
    """Return the results of every kind as a Markdown table."""
    lines = ["| faults | trials | broken promises | worst silence | steps or images lost, all reported |"]
    lines.append("|---|---|---|---|---|")
    for kind in TRIALS:
        mine = [result for result in results if result.kind == kind and not result.skipped]
        if mine:
            silences = [result.silence_ms for result in mine if result.silence_ms is not None]
            worst = f"{max(silences):.0f} ms" if silences else ""
            failures, lost = sum(bool(result.failure) for result in mine), sum(result.lost for result in mine)
            lines.append(f"| {kind} | {len(mine)} | {failures} | {worst} | {lost or ''} |")
    ran = [result for result in results if not result.skipped]
    lines.append(f"| all | {len(ran)} | {sum(bool(result.failure) for result in ran)} | | |")
    return "\n".join(lines)


def append(file: Path | None, line: Session | Trial) -> None:
    """Append a line to the file of results."""
    if file is not None:
        with file.open("ab") as out:
            out.write(msgspec.json.encode(line) + b"\n")


def campaign(
    *, seed: int, minutes: float, scale: float, only: str, skip: str, file: Path | None
) -> list[Trial]:
    """Run all trials that the file does not contain yet, until the time is over."""
    results = []
    if file is not None and file.exists():
        results = [result for _, result in read_campaign(file, TRIALS)]
    done, end_s = {(result.kind, result.number) for result in results}, time.monotonic() + 60 * minutes
    append(file, Session(FORMAT, seed, new_origin(command=shlex.join(["python", *sys.argv]))))
    with tempfile.TemporaryDirectory() as samples:
        make_samples(Path(samples))
        for kind, number in planned(scale, only, skip):
            if (kind, number) in done or time.monotonic() > end_s:
                continue
            result = run_trial(kind, number, seed, Path(samples))
            results.append(result)
            append(file, result)
            note = result.failure or result.skipped
            if note:
                sys.stderr.write(f"{kind} {number}: {note}\n")
    return results


def main() -> None:
    signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a shell's background job ignores it, and so would runs
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=55)
    parser.add_argument("--scale", type=float, default=1.0, help="share of the trials")
    parser.add_argument("--only", default="", help="kinds of faults that contain this text")
    parser.add_argument("--skip", default="none", help="kinds that contain this text")
    parser.add_argument("--results", type=Path)
    options = parser.parse_args()
    results = campaign(
        seed=options.seed,
        minutes=options.minutes,
        scale=options.scale,
        only=options.only,
        skip=options.skip,
        file=options.results,
    )
    sys.stdout.write(table(results) + "\n")
    sys.stdout.flush()
    trials_of_input.end()
    sys.exit(any(result.failure for result in results))


if __name__ == "__main__":
    main()
