"""Commands that place a robot in space and time: robot calibrate, sync-check."""

import sys
import time
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from haptigraph.analysis.robot.calibrating import TouchedPoints
    from haptigraph.robot.setup import ShaftAxis

__all__ = ["calibrate", "sync_check"]

AXES = ("+x", "-x", "+y", "-y", "+z", "-z")
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
    help="Standard deviation of one touched point, per axis.",
)
@click.option("--force", is_flag=True, help="Overwrite an existing file; its limits are kept.")
def calibrate(
    output: str,
    recording: str | None,
    points: str | None,
    robot: str | None,
    pivot: str | None,
    shaft_axis: "ShaftAxis",
    sd_mm: float,
    force: bool,
) -> None:
    """Find where the eye is in the robot's base, and write robot.toml.

    Either from a recorded run (--run) whose images show the needle that the robot moves in the section, or
    from known points of the eye that the robot touches (--points). With --robot, each point is touched by
    hand and confirmed with Enter; nothing is commanded. The pivot comes from the same run, or from the point
    `trocar`.

    Research software, not a medical device.
    """
    from haptigraph.analysis.robot.calibrating import (
        from_points,
        from_run,
        pivot_of,
        read_points,
        write_setup,
    )

    if (recording is None) == (points is None):
        raise BadInput("robot calibrate takes either --run RUN or --points FILE")
    if recording is not None:
        if robot is not None or pivot is not None:
            raise BadInput("--robot and --pivot go with --points")
        calibration, rcm, lines = from_run(recording, shaft_axis)
    else:
        given = read_points(str(points))
        if robot is not None:
            given = _touched(given, robot)
        centre = pivot_of(pivot, shaft_axis) if pivot else None
        calibration, rcm, lines = from_points(given, sd_mm, centre)
    write_setup(output, calibration, rcm, shaft_axis, str(recording or points), force=force)
    for line in (*lines, f"written         {output}"):
        click.echo(line)


def _touched(points: "TouchedPoints", uri: str) -> "TouchedPoints":
    """Ask for every point, and return them with the robot's positions."""
    from contextlib import closing

    import numpy as np

    from haptigraph.clock import MonotonicClock
    from haptigraph.robot.listening import Listener
    from haptigraph.robot.opening import open_robot

    clock = MonotonicClock()
    positions = []
    with closing(Listener(lambda of: open_robot(uri, of), clock, None)) as listener:
        for name, eye_mm in zip(points.names, points.eye_mm.tolist(), strict=True):
            where = ", ".join(f"{one:.2f}" for one in eye_mm)
            click.prompt(
                f"touch {name} ({where} mm), hold still, press Enter", default="", show_default=False
            )
            listener.take()
            time.sleep(STILL_S)
            seen = np.array([one.position_mm for one in listener.take()])
            if not len(seen):
                raise BadInput(
                    f"{uri} reported no pose for {STILL_S:g} s; check it with `haptigraph robot check`"
                )
            if np.ptp(seen, axis=0).max() > STILL_MM:
                raise BadInput(
                    f"the robot moved by {np.ptp(seen, axis=0).max():.2f} mm while touching {name}"
                )
            positions.append(seen.mean(axis=0))
    return type(points)(points.names, points.eye_mm, np.array(positions), points.file)


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
    """Estimate from motion how well the clocks of camera, robot and touch agree in RECORDING.

    The lag between images and robot is estimated with a 95 % interval, up to 5 s, and how it drifts. Exit
    code 1: it is certainly more than the 10 ms that comparing the two tips allows for, and not corrected by
    this call. Exit code 2: it cannot be estimated, for instance because there is too little motion.
    """
    import msgspec

    from haptigraph.analysis.robot.sync import check_sync, correct, sync_lines

    report = check_sync(recording)
    if as_json:
        click.echo(msgspec.json.encode(report).decode())
    else:
        for line in sync_lines(report):
            click.echo(line)
    if output is not None:
        click.echo(f"{output}: {correct(recording, output, report.robot)}", err=as_json)
    elif not report.is_aligned:
        click.echo("not aligned: write a corrected copy with --correct FILE", err=as_json)
        sys.exit(1)
