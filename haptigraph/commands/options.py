"""Options shared by several commands, and their conversion to settings."""

from collections.abc import Callable, Mapping
from functools import reduce
from typing import TYPE_CHECKING, Any, TypeVar

import click

from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from haptigraph.dashboard.server.access import Tokens

__all__ = [
    "config_option",
    "page_options",
    "page_tokens",
    "procedure_option",
    "profile_option",
    "run_options",
    "run_settings",
    "set_option",
    "settings_of",
    "voxel_option",
]

Command = TypeVar("Command", bound=Callable[..., Any])


class _VoxelSize(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """Three lengths in mm, separated by commas."""

    name = "mm,mm,mm"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the three lengths."""
        try:
            axial_mm, slice_mm, column_mm = map(float, str(value).split(","))
        except ValueError:
            axial_mm = slice_mm = column_mm = 0.0
        if not all(0 < size < 10 for size in (axial_mm, slice_mm, column_mm)):
            raise BadInput(f"--voxel-mm {value}: expected three lengths in mm, such as 0.0058,0.079,0.051")
        return axial_mm, slice_mm, column_mm


voxel_option = click.option(
    "--voxel-mm",
    type=_VoxelSize(),
    metavar="AXIAL,SLICE,LATERAL",
    help="Size of a voxel of --volumes in mm; default: 0.0058,0.079,0.051.",
)
procedure_option = click.option(
    "--procedure", metavar="NAME|FILE", help="Rules and haptic patterns; default: subretinal_injection."
)
profile_option = click.option(
    "--profile", metavar="FILE", help="How strong the device feels, from `haptigraph devices calibrate`."
)
config_option = click.option("--config", metavar="FILE", help="Settings file (TOML).")
set_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Override one setting, e.g. perception.alpha=1; repeatable.",
)

RUN = {
    "source": "source.uri",
    "registration": "source.registration",
    "procedure": "run.procedure",
    "device": "haptics.device",
    "profile": "haptics.profile",
    "force": "haptics.force",
    "leader": "run.leader",
    "bridge": "run.bridges",
    "record": "recording.path",
    "robot": "robot.uri",
    "robot_setup": "robot.setup",
    "accept_assumed": "haptics.accept_assumed",
}
"""Arguments of every command that runs the loop, and the settings they stand for."""


def page_options(command: Command) -> Command:
    """Add --port, --host and --token to a command that serves a page."""
    decorators = (
        click.option("--port", type=click.IntRange(1, 65535), help="Port of the page; default: a free one."),
        click.option(
            "--host",
            default="127.0.0.1",
            show_default=True,
            help="Address to serve on; 0.0.0.0: all, for other computers too.",
        ),
        click.option("--token", metavar="TOKEN", help="Secret to steer; generated if --host needs one."),
    )
    return reduce(lambda made, decorator: decorator(made), reversed(decorators), command)


def page_tokens(host: str, token: str | None) -> "Tokens":
    """Return the secrets for visitors of a page; none if only this machine can reach the page."""
    import secrets

    from haptigraph.dashboard.server.access import LOOPBACK, Tokens

    if host in LOOPBACK:
        return Tokens(token or "")
    return Tokens(token or secrets.token_urlsafe(12), watch=secrets.token_urlsafe(12))


def run_options(command: Command) -> Command:
    """Add the arguments in `RUN`, --config and --set to a command."""
    decorators = (
        click.argument("source", required=False),
        click.option("--registration", metavar="FILE", help="Position of the anatomy in the images (TOML)."),
        procedure_option,
        click.option("--device", metavar="DEVICE", help="Haptic device; `haptigraph devices` lists all."),
        profile_option,
        click.option(
            "--force",
            metavar="FORCE",
            help="Device that pushes the hand and steers: inverse3, simulated, ...",
        ),
        click.option(
            "--leader",
            metavar="LEADER",
            help="What steers teleop: gamepad:N, keys, joy[:TOPIC] or crtk:NAMESPACE.",
        ),
        click.option(
            "--bridge",
            multiple=True,
            metavar="BRIDGE",
            help="Publish live: ros2[:NAME], lsl, openigtlink[:PORT], foxglove[:PORT]; repeatable.",
        ),
        click.option(
            "--accept-assumed",
            is_flag=True,
            default=None,
            help="Vibrate although the registration assumes the target (documentation: Safety).",
        ),
        click.option(
            "--robot", metavar="ROBOT", help="Read a robot, e.g. crtk:PSM1; only live --steer moves it."
        ),
        click.option("--robot-setup", metavar="FILE", help="Where the robot is (robot.toml)."),
        click.option(
            "--record",
            metavar="FILE",
            help="Record the run to a new MCAP file; 1280 x 720 at 30 images/s takes about 4 MB a second.",
        ),
        config_option,
        set_option,
    )
    return reduce(lambda made, decorator: decorator(made), reversed(decorators), command)


def run_settings(given: Mapping[str, object], realtime: bool | None) -> tuple[str, ...]:
    """Return the settings of a command with `run_options`.

    Args:
        given: Its arguments; those in `RUN` override --set.
        realtime: The setting `run.realtime`.
    """
    options = {**{key: given.get(name) for name, key in RUN.items()}, "run.realtime": realtime}
    settings: Any = given["settings"]
    return (*settings, *settings_of(options))


def settings_of(options: Mapping[str, object]) -> tuple[str, ...]:
    """Turn command-line options into settings; a string is quoted as TOML so that it stays a string."""
    import json

    return tuple(f"{key}={json.dumps(value)}" for key, value in options.items() if value not in (None, ()))
