"""The entry point: the group of all commands, and their error handling.

Commands parse, assemble and call; they import heavy modules only when they run.
"""

import warnings
from typing import Any

import click

from haptigraph.commands.archives.archive import archive, query
from haptigraph.commands.archives.batch import batch
from haptigraph.commands.devices import devices
from haptigraph.commands.evaluate import evaluate
from haptigraph.commands.explain import diagram, evidence, explain, figure
from haptigraph.commands.help import TaskGroup, examples
from haptigraph.commands.live import live
from haptigraph.commands.preparing import check, procedure, register
from haptigraph.commands.publishing.export import export
from haptigraph.commands.publishing.recording import export_recording
from haptigraph.commands.publishing.video import video
from haptigraph.commands.recordings import recover, replay
from haptigraph.commands.rigs.calibrate_camera import calibrate_lens
from haptigraph.commands.rigs.check import rig_check
from haptigraph.commands.rigs.predict import rig_predict
from haptigraph.commands.rigs.rig import rig
from haptigraph.commands.robots.calibrate import calibrate, sync_check
from haptigraph.commands.robots.check import robot_check
from haptigraph.commands.robots.robot import robot
from haptigraph.commands.robots.steer import robot_steer
from haptigraph.commands.running import demo, run
from haptigraph.commands.sources import sources
from haptigraph.commands.studies.erase import erase
from haptigraph.commands.studies.report import measure, study_report
from haptigraph.commands.studies.run import study_run
from haptigraph.commands.studies.simulated import simulate, sweep
from haptigraph.commands.study import study
from haptigraph.commands.terminal import print_status
from haptigraph.commands.touch import touch
from haptigraph.errors import HaptigraphError, Implausible, NotDrawn, RenamedKey
from haptigraph.version import __version__

__all__ = ["main"]

WARNINGS = (RenamedKey, Implausible, NotDrawn)
"""Whose message is a whole sentence for users."""


class Commands(TaskGroup):
    """A group whose commands report a user's error in one sentence and exit with code 2."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the chosen command."""
        try:
            with warnings.catch_warnings():
                for category in WARNINGS:
                    warnings.simplefilter("once", category)
                warnings.showwarning = _show_warning
                return super().invoke(ctx)
        except HaptigraphError as error:
            print_status(f"haptigraph: {error}")
            ctx.exit(2)
        except BrokenPipeError:
            raise  # the reader of a pipe has closed it; click exits quietly
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            print_status(f"haptigraph: {where}{error.strerror or error}")
            ctx.exit(2)
        except KeyboardInterrupt:
            print_status("haptigraph: stopped")
            ctx.exit(130)


def _show_warning(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
    kind = "" if issubclass(category, WARNINGS) else f"{category.__name__}: "
    print_status(f"haptigraph: {kind}{message}")


@click.group(
    cls=Commands,
    tasks={
        "Try it": ("live", "demo"),
        "Your own video or camera": ("sources", "calibrate", "register", "rig", "run"),
        "Recordings": ("replay", "explain", "figure", "export", "sync-check", "recover"),
        "Many recordings": ("archive", "query", "batch"),
        "Rules and haptic feedback": ("procedure", "check", "diagram", "evidence", "devices", "touch"),
        "Robots": ("robot",),
        "Accuracy": ("evaluate",),
        "Studies with people": ("study",),
    },
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    epilog=examples("haptigraph live", "haptigraph COMMAND --help"),
)
@click.version_option(__version__, prog_name="haptigraph")
def main() -> None:
    """Turn images of an instrument inside the eye into haptic feedback.

    Research software, not a medical device.
    """


for command in (
    run,
    live,
    replay,
    evaluate,
    calibrate_lens,
    register,
    rig,
    check,
    procedure,
    explain,
    figure,
    export_recording,
    diagram,
    evidence,
    devices,
    touch,
    robot,
    sources,
    study,
    sync_check,
    recover,
    archive,
    query,
    batch,
    demo,
):
    main.add_command(command)
for command in (study_run, study_report, measure, export, video, erase, simulate, sweep):
    study.add_command(command)
rig.add_command(rig_check)
rig.add_command(rig_predict)
for command in (calibrate, robot_check, robot_steer):
    robot.add_command(command)
