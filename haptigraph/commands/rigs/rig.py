"""The group of commands for rigs."""

import click

from haptigraph.commands.help import TaskGroup, examples

__all__ = ["rig"]


@click.group(
    cls=TaskGroup,
    tasks={"Before a run": ("check",)},
    epilog=examples("haptigraph rig check camera:0 --registration eye.toml --rig rig.toml"),
)
def rig() -> None:
    """Check a rig: a printed eye, its light, mirror and camera.

    Research software, not a medical device.
    """
