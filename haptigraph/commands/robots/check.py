"""The command `robot check`: whether a robot's interface is what motion relies on, before anything moves."""

import sys
from pathlib import Path

import click

from haptigraph.commands.help import examples
from haptigraph.commands.robots.robot import SAFETY
from haptigraph.commands.terminal import progress_bar

__all__ = ["robot_check"]

STEP_S = 0.1
STILL_S = 3.0


@click.command(
    "check",
    epilog=examples(
        "haptigraph robot check crtk:PSM1 --setup robot.toml",
        "haptigraph robot check crtk:PSM1 --setup robot.toml --enable",
        "haptigraph robot check 'servo:servo_node?base=base_link&tool=tool0' --seconds 20 --json check.json",
    ),
)
@click.argument("uri", metavar="ROBOT")
@click.option(
    "--setup", metavar="FILE", help="The robot's robot.toml; the report robot_check.json is kept beside it."
)
@click.option(
    "--seconds",
    "duration_s",
    type=click.FloatRange(3, 600),
    default=10.0,
    show_default=True,
    metavar="S",
    help="Time during which you move the robot by hand.",
)
@click.option(
    "--enable",
    is_flag=True,
    help="Afterwards enable the robot, command it the pose at which it stands, and disable it again.",
)
@click.option("--json", "json_path", metavar="FILE", help="Write the report there, too.")
def robot_check(
    uri: str, setup: str | None, duration_s: float, *, enable: bool, json_path: str | None
) -> None:
    """Check the interface of ROBOT: frames, units, rates, stamps, states, latency.

    Bring the tip near the trocar, and move the robot by hand in every direction until the time is over.
    Nothing is commanded without --enable. The exit code is 0 only if nothing was found, 1 otherwise, and 2
    if the check could not begin. Without a passed check haptigraph does not steer a robot.
    """
    from haptigraph.clock import MonotonicClock
    from haptigraph.findings import write_report
    from haptigraph.robot.check_report import report_path
    from haptigraph.robot.checking.judging import judge
    from haptigraph.robot.checking.listening import listener
    from haptigraph.robot.checking.report import full_report, lines
    from haptigraph.robot.setup import load_setup

    loaded = load_setup(setup) if setup is not None else None
    clock, opened = MonotonicClock(), listener(uri)
    try:
        click.echo(SAFETY)
        click.echo(f"Move {uri} by hand, in every direction, for {duration_s:g} s.")
        steps = round(duration_s / STEP_S)
        with progress_bar() as report_progress:
            for step in range(steps):
                clock.wait_until(clock.now_ns() + round(STEP_S * 1e9))
                report_progress("recording", step + 1, steps)
        judgement = judge(opened.snapshot(), loaded, opened.presence())
        if enable and judgement.passed:
            click.echo(
                f"Leave {uri} alone: it is enabled in {STILL_S:g} s, and commanded to stay where it is."
            )
            clock.wait_until(clock.now_ns() + round(STILL_S * 1e9))
            judgement = judgement.with_enabling(opened.enable())
    finally:
        opened.close()
    report = full_report(uri, judgement)
    for line in lines(report):
        click.echo(line)
    for path in (report_path(setup) if setup is not None else None, json_path):
        if path is not None:
            write_report(report, Path(path))
            click.echo(f"report: {path}")
    if not report.passed:
        sys.exit(1)
