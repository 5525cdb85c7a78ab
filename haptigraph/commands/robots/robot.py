"""The group of commands for robots."""

import click

from haptigraph.commands.help import TaskGroup, examples

__all__ = ["SAFETY", "robot"]

SAFETY = (
    "Research software, not a medical device: move a robot only where nobody and nothing can be harmed, with "
    "its own emergency stop at hand."
)


@click.group(
    cls=TaskGroup,
    tasks={"Before it moves": ("check",), "Find it": ("calibrate",), "Move it": ("steer",)},
    epilog=examples(
        "haptigraph robot check crtk:PSM1 --setup robot.toml",
        "haptigraph robot steer simulated --setup examples/robot.toml --leader keys",
    ),
)
def robot() -> None:
    """Check, calibrate and steer a robot that holds the instrument.

    Research software, not a medical device.
    """
