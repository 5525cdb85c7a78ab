"""Commands for studies: study new, check, status, export, import."""

import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptigraph.commands.help import TaskGroup, examples
from haptigraph.commands.terminal import print_status
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from haptigraph.recording.writer import Progress
    from haptigraph.study.exchange.exporting import About
    from haptigraph.study.protocol import Protocol
    from haptigraph.study.roster import Study
    from haptigraph.study.store import Store

__all__ = [
    "STORE",
    "check",
    "existing_store",
    "export_measured",
    "folder_argument",
    "import_",
    "measured_study",
    "missing_store",
    "new",
    "status",
    "store_option",
    "study",
]

STORE = "study.db"

folder_argument = click.argument("folder", default=".")
store_option = click.option(
    "--store",
    metavar="FILE|URL",
    help="The study's store: an SQLite file, or postgresql://...  [FOLDER/study.db]",
)
unblind_option = click.option(
    "--unblind", is_flag=True, help='With blind = "everyone": show who gets which condition.'
)


@click.group(
    cls=TaskGroup,
    tasks={
        "Prepare": ("new", "check", "simulate", "sweep"),
        "Run": ("run", "status"),
        "Analyse": ("report", "video", "measure", "export", "import"),
        "Withdrawal of consent": ("erase",),
    },
    epilog=examples("haptigraph study new my-study", "haptigraph study run my-study"),
)
def study() -> None:
    """Studies with people: write and check a protocol, show the progress, export the data.

    FOLDER is the study's: it contains study.toml, the recordings, and study.db unless --store is given.
    """


@study.command(
    epilog=examples(
        "haptigraph study new my-study",
        "haptigraph study check my-study",
    )
)
@folder_argument
def new(folder: str) -> None:
    """Write the paper's protocol, ready to run."""
    from importlib import resources

    path = Path(folder) / "study.toml"
    Path(folder).mkdir(parents=True, exist_ok=True)
    text = resources.files("haptigraph.study").joinpath("templates").joinpath("study.toml").read_bytes()
    try:
        with path.open("xb") as file:
            file.write(text)
    except FileExistsError:
        raise BadInput("exists already; a protocol is never overwritten", path) from None
    click.echo(f"{path} was written; adapt it, then: haptigraph study check {folder}")


@study.command(
    epilog=examples(
        "haptigraph study check my-study",
        "haptigraph study check my-study --preregistration preregistration.md",
    )
)
@folder_argument
@store_option
@unblind_option
@click.option(
    "--preregistration",
    metavar="FILE",
    help="Also write the text to register before the first participant (Markdown).",
)
def check(folder: str, store: str | None, unblind: bool, preregistration: str | None) -> None:
    """Check protocol and recordings, list all assignments.

    Shows orders, targets, whether the protocol is frozen, and how many participants withdrew; with blind =
    "everyone", no orders without --unblind. Exit code 1 if a recording is missing or was changed, or one of
    an erased participant still exists.
    """
    from haptigraph.analysis.study.overview import planned_warning, protocol_tables
    from haptigraph.study.plan import plan_of
    from haptigraph.study.protocol import load_protocol

    protocol = load_protocol(folder)
    problems: list[str] = []
    about = None
    state, sha256 = "not frozen: no participant is enrolled yet", protocol.sha256
    with existing_store(folder, store) as opened:
        stored = _study_in(opened, protocol) if opened else None
        frozen = stored.check_frozen() if stored else None
        if opened and stored and frozen:
            from haptigraph.study.exchange.exporting import about_study
            from haptigraph.study.recordings import recorded_trials, recording_problem

            trials = recorded_trials(opened, protocol.study.name)
            problems = [problem for trial in trials if (problem := recording_problem(trial, protocol.folder))]
            summary = f"{len(trials) - len(problems)} of {len(trials)} recordings are unchanged"
            withdrawn, erased, unfinished = _withdrawn(stored)
            problems += unfinished
            if withdrawn:
                summary += f"\n{withdrawn} withdrew, {erased} of them with all data erased"
            summary += "".join(f"\n{line}" for line in _bundle_lines(stored))
            by = ", by SIMULATED participants" if stored.simulated else ""
            state = f"frozen since {frozen['frozen_utc'][:16].replace('T', ' ')} UTC{by}\n{summary}"
            sha256 = frozen["protocol_sha256"]
            about = about_study(opened, protocol.study.name)
        plan = stored.planner() if stored else partial(plan_of, protocol)
        plans = [plan(slot) for slot in range(protocol.study.participants)]
    if preregistration is not None:
        _write_preregistration(protocol, about, Path(preregistration))
    for table in protocol_tables(protocol, plans.__getitem__, is_blind=_is_blind(protocol, unblind)):
        _print(table)
    if warning := planned_warning(protocol, plans.__getitem__):
        click.echo(warning)
    if protocol.analysis is None:
        click.echo("no [analysis] table: the report will be exploratory")
    click.echo(f"{state}\nsha256 {sha256}")
    for problem in problems:
        print_status(f"haptigraph: {problem}")
    if problems:
        sys.exit(1)
    click.echo("no errors")


@study.command(
    epilog=examples("haptigraph study status my-study", "haptigraph study status my-study --unblind")
)
@folder_argument
@store_option
@unblind_option
def status(folder: str, store: str | None, unblind: bool) -> None:
    """Show the progress of every participant."""
    from haptigraph.analysis.study.overview import status_table
    from haptigraph.study.protocol import load_protocol

    protocol = load_protocol(folder)
    with existing_store(folder, store) as opened:
        stored = _study_in(opened, protocol) if opened else None
        if stored is None or not stored.check_frozen():
            click.echo(f"{protocol.study.title}: no participant yet")
            return
        from haptigraph.study.status import participant_statuses

        if stored.simulated:
            click.echo("simulated participants")
        is_blind = _is_blind(protocol, unblind)
        _print(status_table(protocol, participant_statuses(stored), is_blind=is_blind))


def export_measured(
    folder: str, store: str | None, output: str, progress: "Progress", *, parquet: bool = False
) -> None:
    """Compute missing measures, and export; list the recordings that could not be measured."""
    from haptigraph.study.exchange.exporting import export_study
    from haptigraph.study.exchange.parquet import parquet_writer

    more = {"parquet": parquet_writer()} if parquet else {}
    with measured_study(folder, store, output, progress) as (opened, protocol, problems):
        export_study(opened, protocol.study.name, output, more, protocol)
    for problem in problems:
        print_status(f"haptigraph: not measured: {problem}")


@study.command(name="import", epilog=examples("haptigraph study import exported --store copy.db"))
@click.argument("exported")
@click.option(
    "--store", metavar="FILE|URL", required=True, help="The store: an SQLite file, or postgresql://..."
)
def import_(exported: str, store: str) -> None:
    """Import an export into a store that does not contain the study.

    EXPORTED is a folder that `study export` wrote.
    """
    from haptigraph.study.exchange.importing import import_study, read_export
    from haptigraph.study.store import Store

    read = read_export(exported)
    with closing(Store(store)) as opened:
        import_study(opened, read)
        click.echo(f"study {read.about.study} is in {opened.name}")


@contextmanager
def existing_store(folder: str, store: str | None) -> Iterator["Store | None"]:
    """Open the store; do not create a missing file."""
    where = store or str(Path(folder if Path(folder).is_dir() else Path(folder).parent) / STORE)
    if "://" not in where and not Path(where).exists():
        if store:
            raise BadInput("does not exist", store)
        yield None
        return
    from haptigraph.study.store import Store

    with closing(Store(where)) as opened:
        yield opened


@contextmanager
def measured_study(
    folder: str, store: str | None, output: str, progress: "Progress"
) -> Iterator[tuple["Store", "Protocol", list[str]]]:
    """Open a study to export it into a new folder; compute missing measures, with what was not measured."""
    from haptigraph.study.protocol import load_protocol

    protocol = load_protocol(folder)
    with existing_store(folder, store) as opened:
        if opened is None:
            raise missing_store(folder)
        from haptigraph.analysis.study.measures import measure_study

        if Path(output).exists():
            raise BadInput("exists already; an export never overwrites", output)
        yield opened, protocol, measure_study(opened, protocol.study.name, protocol.folder, progress)


def missing_store(folder: str) -> BadInput:
    """Return the error for a missing store."""
    return BadInput("does not exist; the first enrolment creates it", Path(folder) / STORE)


def _write_preregistration(protocol: "Protocol", about: "About | None", path: Path) -> None:
    from haptigraph.study.sharing.preregistration import preregistration

    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(preregistration(protocol, about))
    except FileExistsError:
        raise BadInput("exists already; a preregistration is never overwritten", path) from None
    except OSError as error:
        raise BadInput(f"cannot be written ({error.strerror})", path) from None
    click.echo(f"{path} was written{'' if about else '; register it before the first participant comes'}")


def _is_blind(protocol: "Protocol", unblind: bool) -> bool:
    """Return whether the output must not show who gets which condition; say what is shown or hidden."""
    if protocol.study.blind != "everyone":
        if unblind:
            click.echo(f'--unblind has no effect: blind = "{protocol.study.blind}" hides nothing from you')
        return False
    shown = "UNBLINDED: whoever reads this knows" if unblind else "blinded: --unblind shows"
    click.echo(f"{shown} who gets which condition")
    return not unblind


def _study_in(store: "Store", protocol: "Protocol") -> "Study":
    from haptigraph.study.roster import study_in

    return study_in(store, protocol)


def _withdrawn(study: "Study") -> tuple[int, int, list[str]]:
    """Count withdrawn and erased participants; list the remaining files of the erased."""
    from haptigraph.study.erasure import remaining_files
    from haptigraph.study.tables import is_erased

    people, folder = study.participants(), study.protocol.folder
    erased = [row["participant"] for row in people if is_erased(row)]
    problems = [
        f"{file} of {name}, whose data were erased, still exists; run `study erase` again"
        for name in erased
        for file in remaining_files(folder, name)
    ]
    return sum(row["withdrawn_utc"] is not None for row in people), len(erased), problems


def _bundle_lines(study: "Study") -> Iterator[str]:
    """Yield the bundles of a study, and what they contain of erased participants."""
    from haptigraph.study.sharing.registry import read_bundles
    from haptigraph.study.tables import is_erased

    erased = [row["participant"] for row in study.participants() if is_erased(row)]
    for bundle in read_bundles(study.protocol.folder):
        gone = "" if bundle.is_there else ", no longer there"
        yield f"bundle {bundle.path}, {bundle.made_utc[:10]}, participants: {len(bundle.participants)}{gone}"
        still = [f"{name} as {bundle.participants[name]}" for name in erased if name in bundle.participants]
        if still:
            yield f"  contains data that were erased here: {', '.join(still)}"


def _print(table: Any) -> None:
    from rich.console import Console

    # Without markup, as text may be the user's. Lines are wrapped on terminals only.
    console = Console(markup=False, emoji=False, width=None if sys.stdout.isatty() else 10_000)
    console.print(table)
