"""Help texts: commands sorted by task, whole sentences, examples."""

from collections.abc import Mapping, Sequence
from typing import Any

import click

__all__ = ["TaskGroup", "examples"]

MAX_SENTENCE = 200


def examples(*lines: str) -> str:
    """Return the epilog of a command: lines that can be typed as they are."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)


class TaskGroup(click.Group):
    """A group whose help lists its commands by task, in the order in which a user needs them.

    Args:
        tasks: Names of the commands, by the heading of their task.
        arguments: Of the group.
    """

    def __init__(self, *, tasks: Mapping[str, Sequence[str]], **arguments: Any) -> None:
        super().__init__(**arguments)
        self.tasks = tasks

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands, in the order of the tasks."""
        named = [name for names in self.tasks.values() for name in names]
        return [*named, *(name for name in self.commands if name not in named)]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a section for each task."""
        width = max(map(len, self.commands))
        for task, names in self.tasks.items():
            with formatter.section(task):
                sentences = (self.commands[name].get_short_help_str(MAX_SENTENCE) for name in names)
                formatter.write_dl(
                    [(name.ljust(width), text) for name, text in zip(names, sentences, strict=True)]
                )
