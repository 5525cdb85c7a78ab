"""Import what a text names, when it is chosen: a registry's entry, or "module:Class" of the user's own."""

import inspect
import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from importlib import import_module
from typing import Any

from haptigraph.checksum import sha256_of
from haptigraph.errors import BadInput, HaptigraphError, unknown_name

__all__ = ["chosen", "is_own", "load", "load_own", "module_sha256", "split_own"]

OWN = re.compile(r"((?:[A-Za-z_]\w*\.)*[A-Za-z_]\w*:[A-Z]\w*)(?::(.*))?", re.DOTALL)
"""A class's name begins with a capital, so that "phantom:hover" is none."""


def load(path: str) -> Any:
    """Return what "module:name" names."""
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)


def chosen(registry: Mapping[str, str], what: str, name: str) -> Any:
    """Return what a registry has under a name, or the class of the user's own that "module:Class" names.

    Args:
        registry: "module:name" by name.
        what: The kind of its entries, for messages.
        name: The name that was chosen.

    Raises:
        BadInput: If there is no such name, or the class cannot be imported.
    """
    if name in registry:
        return load(registry[name])
    if is_own(name):
        return load_own(what, name, registry)
    raise BadInput(unknown_name(what, name, registry))


def is_own(name: str) -> bool:
    """Return whether a name has the form "module:Class" or "module:Class:argument"."""
    return OWN.fullmatch(name) is not None


def split_own(name: str) -> tuple[str, str]:
    """Split "module:Class:argument" into "module:Class" and the argument, which may be empty."""
    found = OWN.fullmatch(name)
    return (found[1], found[2] or "") if found else (name, "")


def load_own(what: str, name: str, shipped: Iterable[str] = ()) -> Any:
    """Import a class of the user's own from Python's path.

    Args:
        what: "perceiver", "source" or "device", for messages.
        name: "module:Class".
        shipped: Names of those that need no module, for messages.

    Raises:
        BadInput: If there is no such module or class, or the import fails.
    """
    module_name, _, class_name = name.partition(":")
    try:
        module = import_module(module_name)
    except HaptigraphError:
        raise
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and f"{module_name}.".startswith(f"{error.name}."):
            names = f"; {what}s that ship: {', '.join(sorted(shipped))}" if shipped else ""
            hint = (
                "install it, name its folder in PYTHONPATH, or start `python -m haptigraph` in its folder"
                f"{names}"
            )
            problem = f"Python finds no module {error.name!r}; {hint}"
        else:
            problem = f"importing {module_name!r} fails ({type(error).__name__}: {error})"
        raise BadInput(f"{what} {name}: {problem}") from error
    found = getattr(module, class_name, None)
    if not inspect.isclass(found):
        similar = get_close_matches(class_name, vars(module), n=1)
        hint = f"; did you mean {similar[0]!r}?" if similar and similar[0] != class_name else ""
        raise BadInput(f"{what} {name}: module {module_name!r} has no class {class_name!r}{hint}")
    return found


def module_sha256(name: str) -> str:
    """Return the SHA-256 of the file of an imported "module:Class"; empty without file, as in a notebook."""
    file = getattr(import_module(name.partition(":")[0]), "__file__", None)
    return sha256_of(file) if file else ""
