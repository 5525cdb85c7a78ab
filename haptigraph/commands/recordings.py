"""Commands for recordings: replay, recover."""

import sys

import click

from haptigraph.commands.options import procedure_option
from haptigraph.commands.terminal import progress_bar

__all__ = ["recover", "replay"]


@click.command()
@click.argument("recording")
@procedure_option
def replay(recording: str, procedure: str | None) -> None:
    """Replay RECORDING and compare every step.

    With --procedure, show what would have happened under another procedure. Without, exit with code 1 if
    steps differ.
    """
    from haptigraph.analysis.metrics.replay import replay as run_again
    from haptigraph.analysis.metrics.summary import summary
    from haptigraph.analysis.metrics.temporal import claim_lines

    with progress_bar() as progress:
        report = run_again(recording, procedure, progress)
    if report.is_being_written:
        click.echo("the recording is still being written; this is the replay so far")
    elif not report.is_whole:
        click.echo("the recording was interrupted; `haptigraph recover` repairs it")
    if report.dropped_images:
        click.echo(f"{report.dropped_images} images were not recorded; steps that depend on them differ")
    click.echo(f"{report.identical} of {report.steps} steps identical")
    if report.first is not None:
        first = report.first
        click.echo(f"first difference: step {first.step} at {first.time_s:.2f} s, {first.message}")
        click.echo(f"  recorded  {first.recorded}\n  replayed  {first.replayed}")
    for line in claim_lines(report.recorded.claims, report.recorded.first_ns) if not procedure else ():
        click.echo(line)
    if procedure:
        click.echo(f"\nas recorded\n{summary(report.recorded)}\n\nas {procedure}\n{summary(report.replayed)}")
    elif report.identical < report.steps:
        sys.exit(1)


@click.command()
@click.argument("recording")
def recover(recording: str) -> None:
    """Repair an interrupted RECORDING in place."""
    from haptigraph.recording.reader import RunReader
    from haptigraph.recording.writer import recover as repair

    reader = RunReader(recording)
    with progress_bar() as progress:
        was_interrupted = repair(reader.path, progress)
    steps, _ = RunReader(recording).count()  # reads all of it, so that damage is an error
    click.echo(f"{recording} is complete" + (f" again: {steps} steps" if was_interrupted else ""))
