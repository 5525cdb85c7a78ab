"""The command `rig check`: whether a rig is set up as a run relies on."""

import sys
from pathlib import Path

import click

from haptigraph.commands.help import examples
from haptigraph.commands.options import set_option, settings_of
from haptigraph.commands.terminal import progress_bar

__all__ = ["rig_check"]


@click.command(
    "check",
    epilog=examples(
        "haptigraph rig check camera:0 --registration eye.toml --rig rig.toml",
        "haptigraph rig check clip.mp4 --registration eye.toml --json rig_check.json",
        "haptigraph rig check phantom:align_then_approach --accept-unjudged",
    ),
)
@click.argument("source")
@click.option("--registration", metavar="FILE", help="Position of the anatomy in the images (TOML).")
@click.option("--rig", "rig_file", metavar="FILE", help="The rig as designed (rig.toml).")
@click.option(
    "--seconds",
    "duration_s",
    type=click.FloatRange(1, 60),
    default=5.0,
    show_default=True,
    metavar="S",
    help="How long to watch.",
)
@click.option(
    "--accept-unjudged", is_flag=True, help="Pass although something could not be judged, e.g. without --rig."
)
@click.option("--json", "json_path", metavar="FILE", help="Write the report there, too.")
@set_option
def rig_check(
    source: str,
    registration: str | None,
    rig_file: str | None,
    duration_s: float,
    accept_unjudged: bool,
    json_path: str | None,
    settings: tuple[str, ...],
) -> None:
    """Watch SOURCE for some seconds and check the rig: focus, light, position, scale, stability, frame rate.

    Nothing may move but a needle, which best enters and turns. Every finding has a number, its limit, and
    what to do. The exit code is 0 if all passed, and 1 if something was found or could not be judged.
    """
    from haptigraph.analysis.rig_check.clip import watch
    from haptigraph.analysis.rig_check.judging import judge
    from haptigraph.analysis.rig_check.report import lines, report_of
    from haptigraph.config import load_config
    from haptigraph.findings import write_report
    from haptigraph.registration.loading import load_camera_registration
    from haptigraph.rig.description import load_rig

    rig = load_rig(rig_file) if rig_file is not None else None
    given = load_camera_registration(registration) if registration is not None else None
    config = load_config(
        None, (*settings, *settings_of({"source.uri": source, "source.registration": registration}))
    )
    with progress_bar() as progress:
        clip, used = watch(config, given, duration_s, progress)
    report = report_of(
        judge(clip, used, rig), source, used.sha256, rig.name if rig else "", accepts_unjudged=accept_unjudged
    )
    for line in lines(report):
        click.echo(line)
    if json_path is not None:
        write_report(report, Path(json_path))
        click.echo(f"report: {json_path}")
    if not report.passed:
        sys.exit(1)
