"""Commands for studies: study new, check, status, export, import."""

import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from haptigraph.commands.terminal import progress_bar, tell
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from haptigraph.recording.writer import Progress
    from haptigraph.study.protocol import Protocol
    from haptigraph.study.roster import Study
    from haptigraph.study.store import Store

__all__ = [
    "STORE",
    "check",
    "existing_store",
    "export",
    "export_measured",
    "folder_argument",
    "import_",
    "new",
    "no_store",
    "status",
    "store_option",
    "study",
]

STORE = "study.db"

folder_argument = click.argument("folder", default=".")
store_option = click.option(
    "--store",
    metavar="FILE|URL",
    help="Where the study is kept: SQLite, or postgresql://...  [FOLDER/study.db]",
)


@click.group()
def study() -> None:
    """Studies with people: make a protocol, check it, see how far it is, export what came out.

    FOLDER is the study's: it has study.toml, the recordings, and study.db unless --store says otherwise.
    """


@study.command()
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
    click.echo(f"{path} is written; change it as you like, then: haptigraph study check {folder}")


@study.command()
@folder_argument
@store_option
def check(folder: str, store: str | None) -> None:
    """Check protocol and recordings, tell who gets what.

    Orders, targets, whether the protocol is frozen, how many withdrew; exit code 1 if a recording is gone or
    was changed, or is still there of someone who was erased.
    """
    from haptigraph.analysis.study.overview import protocol_tables
    from haptigraph.study.protocol import load_protocol

    protocol = load_protocol(folder)
    wrong: list[str] = []
    state = "not frozen: no participant was taken in yet"
    with existing_store(folder, store) as kept:
        held = _study_in(kept, protocol) if kept else None
        frozen_utc = held.check_frozen() if held else ""
        if kept and held and frozen_utc:
            from haptigraph.study.recordings import recorded_trials, whats_wrong

            trials = recorded_trials(kept, protocol.study.name)
            wrong = [problem for trial in trials if (problem := whats_wrong(trial, protocol.folder))]
            whole = len(trials) - len(wrong)
            sound = f"{whole} of {len(trials)} recordings are as they were recorded"
            left, erased, unfinished = _withdrawn(held)
            wrong += unfinished
            if left:
                sound += f"\n{left} withdrew, {erased} of them with all data erased"
            whose = ", by SIMULATED participants" if held.simulated else ""
            state = f"frozen since {frozen_utc[:16].replace('T', ' ')} UTC{whose}\n{sound}"
    for table in protocol_tables(protocol):
        _print(table)
    click.echo(f"{state}\nsha256 {protocol.sha256}")
    for problem in wrong:
        tell(f"haptigraph: {problem}")
    if wrong:
        sys.exit(1)
    click.echo("no errors")


@study.command()
@folder_argument
@store_option
def status(folder: str, store: str | None) -> None:
    """Show how far every participant is."""
    from haptigraph.analysis.study.overview import status_table
    from haptigraph.study.protocol import load_protocol

    protocol = load_protocol(folder)
    with existing_store(folder, store) as kept:
        held = _study_in(kept, protocol) if kept else None
        if held is None or not held.check_frozen():
            click.echo(f"{protocol.study.title}: no participant yet")
            return
        from haptigraph.study.standing import standings

        if held.simulated:
            click.echo("simulated participants")
        _print(status_table(protocol, standings(held)))


@study.command()
@folder_argument
@click.option("-o", "--output", metavar="FOLDER", required=True, help="The folder to make.")
@click.option("--parquet", is_flag=True, help="Write the tables as Parquet too; needs haptigraph[parquet].")
@store_option
def export(folder: str, output: str, parquet: bool, store: str | None) -> None:
    """Write tidy CSV with a data dictionary.

    Trials that are not measured yet are measured from their recordings first.
    """
    with progress_bar() as progress:
        export_measured(folder, store, output, progress, parquet=parquet)
    click.echo(f"{output}  data_dictionary.csv says what every column means")


def export_measured(
    folder: str, store: str | None, output: str, progress: "Progress", *, parquet: bool = False
) -> None:
    """Measure what is not measured yet, and export; say which recordings could not be measured."""
    from haptigraph.study.protocol import load_protocol

    more = {}
    if parquet:
        from haptigraph.study.parquet import write_parquet

        more["parquet"] = write_parquet
    protocol = load_protocol(folder)
    with existing_store(folder, store) as kept:
        if kept is None:
            raise no_store(folder)
        from haptigraph.analysis.study.measures import measure_study
        from haptigraph.study.exchange import export_study

        if Path(output).exists():
            raise BadInput("exists already; an export never overwrites", output)
        wrong = measure_study(kept, protocol.study.name, protocol.folder, progress)
        export_study(kept, protocol.study.name, output, more)
    for problem in wrong:
        tell(f"haptigraph: not measured: {problem}")


@study.command(name="import")
@click.argument("exported")
@click.option(
    "--store", metavar="FILE|URL", required=True, help="Where to keep it: SQLite, or postgresql://..."
)
def import_(exported: str, store: str) -> None:
    """Read an export into a store that lacks the study.

    EXPORTED is a folder that `study export` wrote.
    """
    from haptigraph.study.exchange import import_study, read_export
    from haptigraph.study.store import Store

    found = read_export(exported)
    with closing(Store(store)) as kept:
        import_study(kept, found)
        click.echo(f"study {found.about.study} is in {kept.name}")


@contextmanager
def existing_store(folder: str, store: str | None) -> Iterator["Store | None"]:
    """Open the store; a file that is not there yet is not made."""
    where = store or str(Path(folder if Path(folder).is_dir() else Path(folder).parent) / STORE)
    if "://" not in where and not Path(where).exists():
        if store:
            raise BadInput("is not there", store)
        yield None
        return
    from haptigraph.study.store import Store

    with closing(Store(where)) as kept:
        yield kept


def no_store(folder: str) -> BadInput:
    """Return what there is to say where a store should be and is none."""
    return BadInput("is not there; a study is kept from its first participant on", Path(folder) / STORE)


def _study_in(store: "Store", protocol: "Protocol") -> "Study":
    from haptigraph.study.roster import study_in

    return study_in(store, protocol)


def _withdrawn(study: "Study") -> tuple[int, int, list[str]]:
    """Return how many have left, how many of them are erased, and what is still there of these."""
    from haptigraph.study.erasure import remains
    from haptigraph.study.tables import is_erased

    people, folder = study.participants(), study.protocol.folder
    erased = [row["participant"] for row in people if is_erased(row)]
    wrong = [
        f"{file} is still there of {name}, who was erased; run `study erase` again"
        for name in erased
        for file in remains(folder, name)
    ]
    return sum(row["withdrawn_utc"] is not None for row in people), len(erased), wrong


def _print(table: Any) -> None:
    from rich.console import Console

    # No markup: what looks like it is the user's. Where nobody looks, nothing is broken into lines.
    console = Console(markup=False, emoji=False, width=None if sys.stdout.isatty() else 10_000)
    console.print(table)
