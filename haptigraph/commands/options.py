"""Options that several commands share, and how they become settings."""

from collections.abc import Mapping

import click

__all__ = [
    "config_option",
    "procedure_option",
    "registration_option",
    "set_option",
    "settings_of",
]

registration_option = click.option(
    "--registration", metavar="FILE", help="Where the anatomy lies in the images (TOML)."
)
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


def settings_of(options: Mapping[str, object]) -> tuple[str, ...]:
    """Turn command-line options into settings; a text is quoted as TOML so that it stays a text."""
    import json

    return tuple(f"{key}={json.dumps(value)}" for key, value in options.items() if value is not None)
