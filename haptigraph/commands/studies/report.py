"""The commands that analyse a study: study report, study measure."""

import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.commands.study import (
    existing_store,
    export_measured,
    folder_argument,
    missing_store,
    store_option,
)
from haptigraph.commands.terminal import print_status, progress_bar
from haptigraph.errors import MissingExtra

if TYPE_CHECKING:
    from haptigraph.recording.writer import Progress

__all__ = ["measure", "study_report"]

LIBRARIES = ("pandas", "scipy", "statsmodels", "patsy")


@click.command("report", epilog=examples("haptigraph study report my-study -o report"))
@click.argument("folder")
@click.option("-o", "--output", required=True, metavar="OUT", help="The folder to write; created if missing.")
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Of the bootstrap beyond 50 values.",
)
@click.option(
    "--alpha",
    type=click.FloatRange(0, 0.5, min_open=True),
    help="Level of significance; the preregistered one, which it must not contradict, or 0.05 if not given.",
)
@click.option(
    "--zeros",
    type=click.Choice(["dropped", "pratt"]),
    default="dropped",
    show_default=True,
    help="Treatment of pairs without a difference in the signed-rank test.",
)
@click.option(
    "--baseline", metavar="CONDITION", help="The reference condition; the protocol's first if not given."
)
@click.option("--recordings", metavar="FOLDER", help="Folder of the recordings, if not that of the tables.")
@store_option
def study_report(
    folder: str,
    output: str,
    seed: int,
    alpha: float | None,
    zeros: str,
    baseline: str | None,
    recordings: str | None,
    store: str | None,
) -> None:
    """Analyse a study and write the report.

    FOLDER is the study's, which is exported to OUT/tables first, or an export. OUT receives the
    self-contained report.html, the figures as PDF, SVG and PNG, the tables in LaTeX, Markdown and CSV, and
    the methods. It follows the frozen protocol, and says whether that was edited after the first participant.
    """
    try:
        from haptigraph.analysis.study.report import write_report
        from haptigraph.analysis.study.results import AnalysisPlan
    except MissingExtra:
        raise MissingExtra("study report", "study") from None
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in LIBRARIES:
            raise
        raise MissingExtra("study report", "study") from None
    plan = AnalysisPlan(seed, alpha, "pratt" if zeros == "pratt" else "dropped", baseline)
    with progress_bar() as progress, _tables(folder, store, output, progress) as tables:
        written = write_report(tables, output, plan, recordings or folder, progress)
    click.echo(written.summary)
    click.echo(f"{len(written.files)} files; read {written.page}")


@contextmanager
def _tables(folder: str, store: str | None, output: str, progress: "Progress") -> Iterator[Path]:
    """Yield the folder of a study's tables; copy new exports to the output once the report is written."""
    if not (Path(folder) / "study.toml").is_file():
        yield Path(folder)
        return
    with tempfile.TemporaryDirectory(prefix="haptigraph-") as temporary:
        exported = Path(temporary) / "tables"
        export_measured(folder, store, str(exported), progress)
        yield exported
        copy = Path(output) / exported.name
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(exported, copy)


@click.command(epilog=examples("haptigraph study measure my-study"))
@folder_argument
@store_option
def measure(folder: str, store: str | None) -> None:
    """Measure all recorded trials again.

    An export measures only the trials that have no measures. Use this after an update that redefines a
    measure, so that all trials of a study have the same. Trials without a recording keep what they have. Exit
    code 1 if a recording is missing or was changed; its trial keeps its measures.
    """
    from haptigraph.study.protocol import load_protocol

    protocol = load_protocol(folder)
    with existing_store(folder, store) as opened:
        if opened is None:
            raise missing_store(folder)
        from haptigraph.analysis.study.measures import measure_study
        from haptigraph.study.recordings import recorded_trials

        with progress_bar() as progress:
            problems = measure_study(opened, protocol.study.name, protocol.folder, progress, again=True)
        count = len(recorded_trials(opened, protocol.study.name))
    for problem in problems:
        print_status(f"haptigraph: not measured: {problem}")
    click.echo(f"{count - len(problems)} of {count} recorded trials are measured by this version")
    if problems:
        sys.exit(1)
