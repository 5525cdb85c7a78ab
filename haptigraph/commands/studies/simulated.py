"""Commands for simulated participants: study simulate, study sweep."""

import time
import warnings
from pathlib import Path

import click

from haptigraph.commands.help import examples
from haptigraph.commands.spreading import cluster_of, cluster_options, usable_cores, workers_option
from haptigraph.commands.study import STORE, folder_argument, store_option
from haptigraph.commands.terminal import progress_bar, terminable
from haptigraph.errors import MissingExtra, RenamedKey

__all__ = ["simulate", "sweep"]


def _current_name(ctx: click.Context, param: click.Parameter, value: str) -> str:
    """Accept the name that the ground truth had in earlier versions."""
    if value != "known":
        return value
    warnings.warn("--perceiver: 'known' is now called 'ground-truth'", RenamedKey, stacklevel=2)
    return "ground-truth"


seed_option = click.option(
    "--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of the participants."
)
perceiver_option = click.option(
    "--perceiver",
    type=click.Choice(["ground-truth", "tracker", "threshold", "known"]),
    metavar="[ground-truth|tracker|threshold]",
    callback=_current_name,
    default="ground-truth",
    show_default=True,
    help="How the needle is detected: as simulated, with the tracker's noise; or on rendered images.",
)


@click.command(epilog=examples("haptigraph study simulate my-copy --participants 12"))
@folder_argument
@click.option("--participants", type=click.IntRange(1, 9999), help="How many; the protocol's if not given.")
@seed_option
@perceiver_option
@workers_option
@store_option
def simulate(
    folder: str, participants: int | None, seed: int, perceiver: str, workers: int | None, store: str | None
) -> None:
    """Simulate a whole study before people take part.

    FOLDER is a study's. Use a copy: a study has people or simulated participants, never both. The same seed
    gives the same store and the same recordings. After an interruption, run it again to resume.
    """
    from haptigraph.study.protocol import load_protocol
    from haptigraph.study.simulated.player import SimulationSpec
    from haptigraph.study.simulated.simulation import simulate as simulate_study

    protocol = load_protocol(folder)
    where = store or str(protocol.folder / STORE)
    spec = SimulationSpec(folder, where, seed, perceiver)
    start_s = time.perf_counter()
    with terminable(), progress_bar() as progress:
        count = participants or protocol.study.participants
        done = simulate_study(spec, count, workers=workers or usable_cores(), progress=progress)
    wall_min = (time.perf_counter() - start_s) / 60
    steered_min = done.steered_s / 60
    click.echo(
        f"{count} SIMULATED participants, {done.participants} of them now: {done.trials} trials, "
        f"{steered_min:.1f} simulated minutes in {wall_min:.1f} real minutes, training included"
    )
    click.echo(f"next: haptigraph study report {Path(folder)} -o {Path(folder) / 'report'}")


@click.command(epilog=examples("haptigraph study sweep my-study -o sweep --participants 1000"))
@folder_argument
@click.option("-o", "--output", required=True, metavar="OUT", help="The folder of results; resumed if there.")
@click.option("--participants", type=click.IntRange(1, 99_999), default=1000, show_default=True)
@seed_option
@click.option(
    "--vary",
    multiple=True,
    metavar="TRAIT=V,V,...",
    help="Modify a trait: a value, or x2 for twice the drawn one; may be repeated.",
)
@perceiver_option
@workers_option
@cluster_options
def sweep(
    folder: str,
    output: str,
    participants: int,
    seed: int,
    vary: tuple[str, ...],
    perceiver: str,
    workers: int | None,
    cluster: str | None,
    tls: str | None,
) -> None:
    """Simulate a study's trials with thousands of participants.

    FOLDER is a study's; nothing in it changes. OUT receives trials.csv, summary.csv and summary.md with
    effect sizes and required sample sizes. After an interruption, run it again to resume.
    """
    from haptigraph.analysis.study_sweep.study_sweep import Sweep, run_sweep, variations_of

    try:
        from haptigraph.analysis.study_sweep.summary import markdown, sweep_summary, trials_table
    except (MissingExtra, ModuleNotFoundError):
        raise MissingExtra("study sweep", "study") from None
    from haptigraph.study.protocol import load_protocol

    protocol = load_protocol(folder)
    spec = Sweep(protocol, participants, seed, variations_of(vary), perceiver)
    start_s = time.perf_counter()
    with terminable(), progress_bar() as progress:
        rows, done = run_sweep(
            spec,
            Path(output),
            workers=workers or usable_cores(),
            cluster=cluster_of(cluster, tls),
            progress=progress,
        )
    wall_min = (time.perf_counter() - start_s) / 60
    trials = trials_table(rows)
    summary = sweep_summary(trials, [each.name for each in protocol.conditions])
    trials.to_csv(Path(output) / "trials.csv", index=False, lineterminator="\n")
    summary.to_csv(Path(output) / "summary.csv", index=False, lineterminator="\n")
    (Path(output) / "summary.md").write_text(markdown(summary), encoding="utf-8")
    click.echo(markdown(summary))
    total, steered_min = len(spec.variations) * participants, trials["steered_s"].sum() / 60
    click.echo(
        f"{len(rows)} trials of {total} participants, {steered_min:.0f} simulated minutes; "
        f"{done} participants were simulated now, in {wall_min:.1f} min"
    )
