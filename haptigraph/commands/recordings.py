"""Commands for recordings: replay, recover."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.commands.terminal import progress_bar
from haptigraph.errors import MissingExtra

if TYPE_CHECKING:
    from haptigraph.analysis.metrics.replay import ReplayReport
    from haptigraph.recording.recovery import Recovery

__all__ = ["recover", "replay"]

MAX_PLACES = 10
ROUNDING = 1e-4  # mm or degrees; what is less comes of another processor or library


@click.command(
    epilog=examples(
        "haptigraph replay run.mcap",
        "haptigraph replay run.mcap --procedure subretinal_injection_cautious",
    )
)
@click.argument("recording")
@click.option(
    "--procedure", metavar="NAME|FILE", help="Another procedure to apply; default: the recorded one."
)
def replay(recording: str, procedure: str | None) -> None:
    """Replay RECORDING and compare every step, or show what another procedure would have done.

    Without --procedure, exit with code 1 if steps differ, be it in the last digits of numbers. With it, they
    may: both outcomes are shown.
    `haptigraph explain RECORDING` says what a recording is, without a replay.
    """
    from haptigraph.analysis.metrics.comparison import comparison
    from haptigraph.analysis.metrics.replay import replay as run_again
    from haptigraph.analysis.metrics.temporal import claim_lines
    from haptigraph.registration.assumed import assumed_lines

    with progress_bar() as progress:
        report = run_again(recording, procedure, progress)
    for line in (*_caveats(report), _robot_line(recording)):
        if line:
            click.echo(line)
    for line in _difference_lines(report):
        click.echo(line)
    for line in assumed_lines(report.assumed):
        click.echo(line)
    for line in claim_lines(report.recorded.claims, report.recorded.first_ns) if not procedure else ():
        click.echo(line)
    if procedure:
        click.echo(f"\n{comparison(report, procedure)}\n\n{_page_lines(Path(recording), procedure, report)}")
    elif report.identical < report.steps:
        sys.exit(1)


def _difference_lines(report: "ReplayReport") -> list[str]:
    """Return how two runs differ: first in what the hand feels and why, then in any number."""
    from haptigraph.analysis.metrics.comparison import identical_line

    if report.first is None:
        return [identical_line(report.identical, report.steps)]
    lines = [
        f"{what} {verb} for {other.lasts_s:.2f} s in {other.steps} of {report.steps} steps, first at "
        f"{other.first_s:.2f} s (step {other.first_step}): {other.replayed} instead of {other.recorded}"
        if other.steps
        else f"{what} {verb} in no step"
        for what, verb, other in (
            ("states", "differ", report.states),
            ("haptic output", "differs", report.haptics),
        )
    ]
    first = report.first
    where = f"step {first.step} at {first.time_s:.2f} s, {first.message}"
    by = report.difference
    if by is not None and by <= ROUNDING and not report.states.steps + report.haptics.steps:
        return [
            *lines,
            f"{report.identical} of {report.steps} steps identical; in the others numbers differ in their "
            f"last digits, by at most {by:.1g}: states and haptic output are the same (documentation: "
            "Recordings, Exactness)",
            f"first difference: {where}",
        ]
    return [
        *lines,
        identical_line(report.identical, report.steps),
        f"first difference: {where}",
        f"  recorded  {first.recorded}\n  replayed  {first.replayed}",
    ]


def _page_lines(recording: Path, procedure: str, report: "ReplayReport") -> str:
    """Return how to see the comparison on the recordings page."""
    from haptigraph.analysis.metrics.page_address import moment_address, page_command, page_procedure

    folder = recording.parent
    known = page_procedure(procedure, folder)
    lines = [
        f"on a page: {page_command(folder)}",
        moment_address(recording.name, step=report.states.first_step, procedure=known),
    ]
    if not known:
        lines.append(f"copy {Path(procedure).name} into {folder} and replay again: then the address compares")
    return "\n".join(lines)


def _robot_line(recording: str) -> str:
    """Return whether robot and images agree in time, as far as known; empty if the run had no robot."""
    from haptigraph.analysis.metrics.replay import recorded_config
    from haptigraph.recording.reader import RunReader

    reader = RunReader(recording)
    if not (reader.info.robot_setup or recorded_config(reader).robot.uri):
        return ""
    try:
        from haptigraph.analysis.robot.sync import robot_note
    except MissingExtra as missing:
        return f"whether the clocks of robot and camera agree is not known: {missing}"
    return robot_note(recording)


def _caveats(report: "ReplayReport") -> list[str]:
    """Return what a replay did not have, or did not have as during the run."""
    from haptigraph.recording.header import losses_sentence
    from haptigraph.recording.stored_video import decoder_name

    lines = list[str]()
    if report.is_being_written:
        lines.append("the recording is still being written; this is the replay so far")
    elif not report.is_whole:
        lines.append("the recording was interrupted; `haptigraph recover` repairs it")
    if report.losses is not None:
        lines.append(losses_sentence(report.losses))
    lines += report.notes
    if report.dropped_images:
        lines.append(f"{report.dropped_images} images were not recorded; steps that depend on them differ")
    if report.differing_images:
        lines.append(
            f"{report.differing_images} images have other pixels here, decoded by {decoder_name()}, than "
            f"during the run, decoded by {report.decoder}; steps that depend on them may differ"
        )
    return lines


@click.command(epilog=examples("haptigraph recover run.mcap"))
@click.argument("recording")
def recover(recording: str) -> None:
    """Verify RECORDING, and repair it if it was interrupted or damaged.

    An interrupted recording is completed in place. What can be read of a damaged one is saved beside it, in
    NAME.recovered.mcap; RECORDING itself is not touched, and the exit code is 1. It is 1, too, if the
    recorder had failed: the steps after that are lost.
    """
    from haptigraph.recording.recovery import recover as repair

    with progress_bar() as progress:
        recovery = repair(Path(recording), progress)
    for line in _recovery_lines(recovery):
        click.echo(line)
    if not recovery.is_lossless or recovery.failure:
        sys.exit(1)


def _recovery_lines(recovery: "Recovery") -> list[str]:
    """Return what a recovery found and did."""
    from haptigraph.recording.header import losses_sentence

    path, lines = recovery.path, list[str]()
    if recovery.saved is None and recovery.is_lossless:
        lines.append(f"{path} {'can be read' if recovery.failure else 'is complete'}")
    elif recovery.saved is None:
        lines.append(f"{path} was recovered: {recovery.steps} complete steps")
        lines.append(losses_sentence(recovery.losses()))
    elif recovery.is_lossless:
        torn = f"; {recovery.left_out_bytes} bytes of an incomplete record are left out"
        lines.append(
            f"{path} can be read again up to its end: {recovery.steps} steps"
            f"{torn if recovery.left_out_bytes else ''}"
        )
    else:
        left_out = f"{recovery.left_out_bytes} bytes are left out" if recovery.lost else "steps are missing"
        lines.append(f"{path} is damaged: {left_out}")
        lines += [
            f"  byte {d.start}: {d.problem}, {d.end - d.start} bytes" for d in recovery.lost[:MAX_PLACES]
        ]
        if len(recovery.lost) > MAX_PLACES:
            lines.append(f"  and {len(recovery.lost) - MAX_PLACES} more places")
        lines.append(losses_sentence(recovery.losses()))
        lines.append(f"{recovery.steps} complete steps are saved in {recovery.saved}; {path} is unchanged")
    if recovery.failure and recovery.is_lossless:
        lines.append(recovery.failure)
    if not recovery.is_verified:
        lines.append("its format has no checksum for each message: changed numbers cannot be noticed")
    lines += [f"removed {copy}, an unfinished copy" for copy in recovery.removed]
    lines += [f"left {copy} as it is; remove it if you do not need it" for copy in recovery.left]
    return lines
