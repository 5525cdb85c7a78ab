"""Options that several commands share, and how they become settings."""

from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any, TypeVar

import click

__all__ = [
    "config_option",
    "page_options",
    "page_token",
    "procedure_option",
    "run_options",
    "run_settings",
    "set_option",
    "settings_of",
]

Command = TypeVar("Command", bound=Callable[..., Any])

procedure_option = click.option(
    "--procedure", metavar="NAME|FILE", help="Rules and touch; subretinal_injection if not given."
)
config_option = click.option("--config", metavar="FILE", help="Settings (TOML).")
set_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="One setting, e.g. perception.alpha=1; may be repeated.",
)

RUN = {
    "source": "source.uri",
    "registration": "source.registration",
    "procedure": "run.procedure",
    "device": "haptics.device",
    "bridge": "run.bridges",
    "record": "recording.path",
}
"""Arguments of every command that runs the loop, and the settings they are short for."""


def page_options(command: Command) -> Command:
    """Give a command --port, --host and --token, for the page it serves."""
    decorators = (
        click.option("--port", type=click.IntRange(1, 65535), help="Of the page; any free one if not given."),
        click.option("--host", default="127.0.0.1", show_default=True, help="Address to serve on."),
        click.option(
            "--token", metavar="TOKEN", help="What visitors must know; made up if --host needs one."
        ),
    )
    return reduce(lambda made, decorator: decorator(made), reversed(decorators), command)


def page_token(host: str, token: str | None) -> str:
    """Return what visitors of a page must know; empty: nothing, where only this machine reaches it."""
    import secrets

    from haptigraph.dashboard.server.access import LOOPBACK

    return token or ("" if host in LOOPBACK else secrets.token_urlsafe(12))


def run_options(command: Command) -> Command:
    """Give a command the arguments of `RUN`, --config and --set."""
    decorators = (
        click.argument("source", required=False),
        click.option("--registration", metavar="FILE", help="Where the anatomy lies in the images (TOML)."),
        procedure_option,
        click.option("--device", metavar="DEVICE", help="What vibrates; `haptigraph devices` lists all."),
        click.option(
            "--bridge",
            multiple=True,
            metavar="BRIDGE",
            help="Tell others live: ros2[:NAME], lsl, openigtlink[:PORT], foxglove[:PORT]; may be repeated.",
        ),
        click.option("--record", metavar="FILE", help="Keep the run in a new MCAP file."),
        config_option,
        set_option,
    )
    return reduce(lambda made, decorator: decorator(made), reversed(decorators), command)


def run_settings(given: Mapping[str, object], realtime: bool | None) -> tuple[str, ...]:
    """Return the settings of a command with `run_options`.

    Args:
        given: Its arguments; those of `RUN` count, after --set.
        realtime: As `run.realtime`.
    """
    options = {**{key: given[name] for name, key in RUN.items()}, "run.realtime": realtime}
    settings: Any = given["settings"]
    return (*settings, *settings_of(options))


def settings_of(options: Mapping[str, object]) -> tuple[str, ...]:
    """Turn command-line options into settings; a text is quoted as TOML so that it stays a text."""
    import json

    return tuple(f"{key}={json.dumps(value)}" for key, value in options.items() if value not in (None, ()))
