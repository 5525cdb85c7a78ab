"""Commands that place a robot in space and time: robot calibrate, sync-check."""

import sys
import time
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    import numpy as np

    from haptigraph.analysis.robot.calibrating import TouchedPoints
    from haptigraph.robot.listening import Listener
    from haptigraph.robot.setup import EyePlace, RcmPlace, ShaftAxis

__all__ = ["calibrate", "sync_check"]

AXES = ("+x", "-x", "+y", "-y", "+z", "-z")
HEARD_S = 5.0  # a robot on a network is found within seconds
STILL_S = 0.5
STILL_MM = 0.2


@click.command(
    epilog=examples(
        "haptigraph robot calibrate -o robot.toml --run run.mcap",
        "haptigraph robot calibrate -o robot.toml --points touched.csv",
        "haptigraph robot calibrate -o robot.toml --points points.csv --robot crtk:PSM1 --pivot run.mcap",
    )
)
@click.option("-o", "--output", metavar="FILE", required=True, help="The robot.toml to write.")
@click.option("--run", "recording", metavar="RUN", help="Recording in which the needle moves in the section.")
@click.option("--points", metavar="FILE", help="CSV of touched points: name, eye_x_mm ... base_z_mm.")
@click.option(
    "--tf", "base_frame", metavar="FRAME", help="ROS 2 frame in whose tf the eye is placed already."
)
@click.option("--robot", metavar="ROBOT", help="Robot to touch the points of --points with, by hand.")
@click.option(
    "--pivot", metavar="RUN", help="Recording in which the robot pivots; default: RUN, or `trocar`."
)
@click.option(
    "--shaft-axis",
    type=click.Choice(AXES),
    default="+z",
    show_default=True,
    help="Axis of the tool that points along the shaft, to the tip.",
)
@click.option(
    "--sd-mm",
    type=click.FloatRange(0.001, 5),
    default=0.1,
    show_default=True,
    help="Standard deviation of one touched point, or of the tip with --tf, per axis.",
)
@click.option("--force", is_flag=True, help="Overwrite an existing file; its limits are kept.")
def calibrate(
    output: str,
    recording: str | None,
    points: str | None,
    base_frame: str | None,
    robot: str | None,
    pivot: str | None,
    shaft_axis: "ShaftAxis",
    sd_mm: float,
    force: bool,
) -> None:
    """Find where the eye is in the robot's base, and write robot.toml.

    From a recorded run (--run) whose images show the needle that the robot moves in the section, or
    from known points of the eye that the robot touches (--points). With --robot, each point is touched by
    hand and confirmed with Enter; nothing is commanded. The pivot comes from the same run, or from the point
    `trocar`. With --tf, the eye's place comes from ROS 2, and --pivot says where the robot pivots.

    Research software, not a medical device.
    """
    from haptigraph.analysis.robot.calibrating import (
        from_points,
        from_run,
        pivot_of,
        read_points,
        write_setup,
    )

    ways = [way for way in (recording, points, base_frame) if way is not None]
    if len(ways) != 1:
        raise BadInput("robot calibrate takes one of --run RUN, --points FILE, --tf FRAME")
    if recording is not None and (robot is not None or pivot is not None):
        raise BadInput("--robot and --pivot go with --points")
    if base_frame is not None:
        eye, rcm, lines = _from_tf(base_frame, pivot, shaft_axis, sd_mm)
        notes: tuple[str, ...] = ("tip_sd_mm was given, not measured",)
    else:
        if recording is not None:
            calibration, rcm, lines = from_run(recording, shaft_axis)
        else:
            given = read_points(ways[0])
            given = _touched(given, robot) if robot is not None else given
            centre = pivot_of(pivot, shaft_axis) if pivot else None
            calibration, rcm, lines = from_points(given, sd_mm, centre)
        eye, notes = calibration.eye, calibration.notes
    write_setup(output, eye, rcm, shaft_axis, ways[0], notes, force=force)
    for line in (*lines, f"written         {output}"):
        click.echo(line)


def _from_tf(
    base_frame: str, pivot: str | None, shaft_axis: "ShaftAxis", sd_mm: float
) -> "tuple[EyePlace, RcmPlace, list[str]]":
    """Return the eye's place in tf, the pivot of a recorded run, and the report."""
    from haptigraph.analysis.robot.calibrating import pivot_of
    from haptigraph.robot.place.calibration import rcm_of
    from haptigraph.robot.place.tf import EYE_FRAME, listen_for_eye

    if pivot is None:
        raise BadInput("--tf goes with --pivot RUN, because tf does not say where the robot pivots")
    rcm = rcm_of(pivot_of(pivot, shaft_axis))
    return listen_for_eye(base_frame, sd_mm), rcm, [f"eye             from tf, {base_frame} -> {EYE_FRAME}"]


def _touched(points: "TouchedPoints", uri: str) -> "TouchedPoints":
    """Ask for every point, and return them with the robot's positions."""
    from contextlib import closing

    import numpy as np

    from haptigraph.clock import MonotonicClock
    from haptigraph.robot.listening import Listener
    from haptigraph.robot.opening import open_robot

    positions = []
    with closing(Listener(lambda of: open_robot(uri, of), MonotonicClock(), None)) as listener:
        if not _is_heard(listener):
            raise BadInput(
                f"{uri} reported no pose for {HEARD_S:g} s; check it with `haptigraph robot check`"
            )
        for name, eye_mm in zip(points.names, points.eye_mm.tolist(), strict=True):
            where = ", ".join(f"{one:.2f}" for one in eye_mm)
            ask, position_mm = f"touch {name} ({where} mm), hold still, press Enter", None
            while position_mm is None:
                click.prompt(ask, default="", show_default=False)
                position_mm = _held_position_mm(listener)
            positions.append(position_mm)
    return type(points)(points.names, points.eye_mm, np.array(positions), points.file)


def _is_heard(listener: "Listener") -> bool:
    """Wait for the robot's first pose; return whether it came."""
    end_s = time.monotonic() + HEARD_S
    while not (is_heard := bool(listener.take())) and time.monotonic() < end_s:
        time.sleep(0.01)
    return is_heard


def _held_position_mm(listener: "Listener") -> "np.ndarray | None":
    """Return the robot's mean position while it holds still; None, and say why, if it does not."""
    import numpy as np

    listener.take()
    time.sleep(STILL_S)
    seen_mm = np.array([one.position_mm for one in listener.take()])
    if not len(seen_mm):
        click.echo(f"not taken: the robot reported no pose for {STILL_S:g} s", err=True)
        return None
    moved_mm = np.ptp(seen_mm, axis=0).max()
    if moved_mm > STILL_MM:
        click.echo(f"not taken: the robot moved by {moved_mm:.2f} mm", err=True)
        return None
    mean_mm: np.ndarray = seen_mm.mean(axis=0)
    return mean_mm


@click.command(
    "sync-check",
    epilog=examples(
        "haptigraph sync-check run.mcap", "haptigraph sync-check run.mcap --correct aligned.mcap"
    ),
)
@click.argument("recording")
@click.option("--correct", "output", metavar="FILE", help="Write a copy with the robot's stamps corrected.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def sync_check(recording: str, output: str | None, as_json: bool) -> None:
    """Estimate from motion how well the clocks of camera, robot, hand and touch agree in RECORDING.

    The lag between images and robot is estimated with a 95 % interval, up to 5 s, and how it drifts; also
    how much later the tip moves than a hand that steers it. Exit code 1: the robot's lag is certainly more
    than the 10 ms that comparing the two tips allows for, and not corrected by this call; or the tip moves
    before the hand. Exit code 2: nothing can be estimated, for instance because there is too little motion.
    """
    import msgspec

    from haptigraph.analysis.robot.sync import check_sync, correct, sync_lines

    report = check_sync(recording)
    if output is not None and report.robot is None:
        raise BadInput("has no robot whose stamps could be corrected", recording)
    if as_json:
        click.echo(msgspec.json.encode(report).decode())
    else:
        for line in sync_lines(report):
            click.echo(line)
    if output is not None and report.robot is not None:
        click.echo(f"{output}: {correct(recording, output, report.robot)}", err=as_json)
    elif not report.is_robot_aligned:
        click.echo("not aligned: write a corrected copy with --correct FILE", err=as_json)
        sys.exit(1)
    elif not report.is_hand_first:
        click.echo("not aligned: the tip moves before the hand that leads it", err=as_json)
        sys.exit(1)
