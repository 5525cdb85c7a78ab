"""Commands for simulated participants: study simulate, study sweep."""

import os
import time
from pathlib import Path

import click

from haptigraph.commands.study import STORE, folder_argument, store_option
from haptigraph.commands.terminal import progress_bar, terminable
from haptigraph.errors import MissingExtra

__all__ = ["simulate", "sweep"]


def _usable_cores() -> int:
    """Return on how many cores this process may run."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


seed_option = click.option(
    "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of the participants."
)
perceiver_option = click.option(
    "--perceiver",
    type=click.Choice(["known", "tracker", "threshold"]),
    default="known",
    show_default=True,
    help="What sees the needle: known is the truth with the tracker's noise; the others get drawn images.",
)
workers_option = click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Processes at once; one for each core if not given. What comes out is the same.",
)


@click.command()
@folder_argument
@click.option("--participants", type=click.IntRange(1, 9999), help="How many; all that the protocol takes.")
@seed_option
@perceiver_option
@workers_option
@store_option
def simulate(
    folder: str, participants: int | None, seed: int, perceiver: str, workers: int | None, store: str | None
) -> None:
    """Let simulated participants go through the whole study: a rehearsal, before people do.

    FOLDER is a study's. Use a copy: a study has people or simulated participants, never both. The same seed
    gives the same store and the same recordings. Killed, it goes on where it was when run again.
    """
    from haptigraph.study.protocol import load_protocol
    from haptigraph.study.simulated.player import Cast
    from haptigraph.study.simulated.simulation import simulate as play_all

    protocol = load_protocol(folder)
    where = store or str(protocol.folder / STORE)
    cast = Cast(folder, where, seed, perceiver)
    begun_s = time.perf_counter()
    with terminable(), progress_bar() as progress:
        count = participants or protocol.study.participants
        played = play_all(cast, count, workers=workers or _usable_cores(), progress=progress)
    wall_min = (time.perf_counter() - begun_s) / 60
    steered_min = played.steered_s / 60
    click.echo(
        f"{count} SIMULATED participants, {played.participants} of them now: {played.trials} trials, "
        f"{steered_min:.1f} simulated minutes in {wall_min:.1f}"
    )
    click.echo(f"next: haptigraph study report {Path(folder)} -o {Path(folder) / 'report'}")


@click.command()
@folder_argument
@click.option("-o", "--output", required=True, metavar="OUT", help="The folder of results; goes on if there.")
@click.option("--participants", type=click.IntRange(1, 99_999), default=1000, show_default=True)
@seed_option
@click.option(
    "--vary",
    multiple=True,
    metavar="TRAIT=V,V,...",
    help="Other participants than drawn: a value, or x2 for twice as much; may be repeated.",
)
@perceiver_option
@workers_option
@click.option(
    "--scheduler", metavar="ADDRESS", default="", help="Of a Dask cluster, in place of this machine."
)
def sweep(
    folder: str,
    output: str,
    participants: int,
    seed: int,
    vary: tuple[str, ...],
    perceiver: str,
    workers: int | None,
    scheduler: str,
) -> None:
    """Play a study's trials with thousands of simulated participants.

    FOLDER is a study's; nothing in it changes. OUT gets trials.csv, summary.csv and summary.md: how large the
    difference is, and how many people it would take. Killed, it goes on where it was when run again.
    """
    from haptigraph.analysis.study_sweep.study_sweep import Sweep, run_sweep, variations_of

    try:
        from haptigraph.analysis.study_sweep.summary import markdown, sweep_summary, trials_table
    except ModuleNotFoundError:
        raise MissingExtra("study sweep", "cluster") from None
    from haptigraph.study.protocol import load_protocol

    protocol = load_protocol(folder)
    asked = Sweep(protocol, participants, seed, variations_of(vary), perceiver)
    begun_s = time.perf_counter()
    with terminable(), progress_bar() as progress:
        count = workers or _usable_cores()
        rows, played = run_sweep(asked, Path(output), workers=count, scheduler=scheduler, progress=progress)
    wall_min = (time.perf_counter() - begun_s) / 60
    trials = trials_table(rows)
    summary = sweep_summary(trials, [each.name for each in protocol.conditions])
    trials.to_csv(Path(output) / "trials.csv", index=False, lineterminator="\n")
    summary.to_csv(Path(output) / "summary.csv", index=False, lineterminator="\n")
    (Path(output) / "summary.md").write_text(markdown(summary), encoding="utf-8")
    click.echo(markdown(summary))
    total, steered_min = len(asked.variations) * participants, trials["steered_s"].sum() / 60
    click.echo(
        f"{len(rows)} trials of {total} participants, {steered_min:.0f} simulated minutes; "
        f"{played} of them were played now, in {wall_min:.1f} min"
    )
