"""Import what a text names, when it is chosen: "module:name"."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from haptigraph.errors import BadInput, unknown_name

__all__ = ["chosen", "load"]


def load(path: str) -> Any:
    """Return what "module:name" names."""
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)


def chosen(registry: Mapping[str, str], what: str, name: str) -> Any:
    """Return what a registry has under a name.

    Args:
        registry: "module:name" by name.
        what: The kind of its entries, for messages.
        name: The name that was chosen.

    Raises:
        BadInput: If there is no such name.
    """
    if name not in registry:
        raise BadInput(unknown_name(what, name, registry))
    return load(registry[name])
