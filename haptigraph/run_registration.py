"""The registration of a run: the configured one, else that of its source."""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from haptigraph.config import Config
from haptigraph.errors import NeedsRegistration
from haptigraph.stages import Source

if TYPE_CHECKING:
    from haptigraph.registration.registered import BaseRegistration

__all__ = ["registration_of"]


def registration_of(config: Config, source: Source, given: "BaseRegistration | None") -> "BaseRegistration":
    """Return the registration of a run.

    Args:
        config: Its [source] table says how images are turned, and where the target is.
        source: The opened source.
        given: The configured registration, if any.

    Raises:
        BadInput: If it does not fit the source.
        NeedsRegistration: If there is none.
    """
    if given is None:
        registration = _own(config, source)
    else:
        turn = import_module("haptigraph.sources.turned").turn_of(source, config.source)
        given.check_turn(turn, config.source.registration)
        registration = given
    if (target_mm := config.source.target_mm) is not None:
        retarget = import_module("haptigraph.registration.retarget")
        registration = retarget.with_target(registration, target_mm)
    return registration


def _own(config: Config, source: Source) -> "BaseRegistration":
    if source.registration is not None:
        loading = import_module("haptigraph.registration.loading")
        own: BaseRegistration = loading.parse_registration(
            source.registration, f"registration of {config.source.uri}"
        )
        return own
    beside = Path(config.source.uri).parent / "registration.toml"
    hint = f"; there is one beside it: {beside}" if beside.is_file() else ""
    raise NeedsRegistration(config.source.uri, hint)
