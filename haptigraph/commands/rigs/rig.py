"""The group of commands for rigs."""

import click

from haptigraph.commands.help import TaskGroup, examples

__all__ = ["rig"]


@click.group(
    cls=TaskGroup,
    tasks={"Before it is built": ("predict",), "Before a run": ("check",)},
    epilog=examples(
        "haptigraph rig predict rig/d405.toml",
        "haptigraph rig check camera:0 --registration eye.toml --rig rig.toml",
    ),
)
def rig() -> None:
    """Predict and check a rig: a printed eye, its light, mirror and camera.

    Research software, not a medical device.
    """
