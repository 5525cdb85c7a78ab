"""The environment of an analysis: Python, system, haptigraph, and the version of every package it uses."""

import platform
from importlib.metadata import PackageNotFoundError, distribution

from packaging.requirements import Requirement

from haptigraph.analysis.evaluation.origin import commit, software_sha256
from haptigraph.version import __version__

__all__ = ["environment", "requirements"]

ROOT = "haptigraph[study]"


def environment() -> str:
    """Return lines about what made the bundle."""
    facts = {
        "haptigraph": __version__,
        "commit": commit() or "unknown: installed as a package",
        "SHA-256 of haptigraph": software_sha256(),
        "Python": f"{platform.python_implementation()} {platform.python_version()}",
        "system": f"{platform.system()} {platform.machine()}",
    }
    return "".join(f"{name}: {fact}\n" for name, fact in facts.items())


def requirements() -> str:
    """Return haptigraph and all packages that its analysis needs, with their versions, as pip reads them."""
    pinned: dict[str, str] = {}
    _pin(Requirement(ROOT), pinned)
    first = f"{ROOT}=={pinned.pop('haptigraph')}\n"
    return first + "".join(f"{name}=={version}\n" for name, version in sorted(pinned.items()))


def _pin(requirement: Requirement, pinned: dict[str, str]) -> None:
    """Add a package and what it needs here."""
    name = requirement.name.lower().replace("_", "-")
    try:
        found = distribution(requirement.name)
    except PackageNotFoundError:
        return
    if name in pinned:
        return
    pinned[name] = found.version
    for text in found.requires or ():
        needed = Requirement(text)
        extras = requirement.extras or {""}
        if needed.marker is None or any(needed.marker.evaluate({"extra": extra}) for extra in extras):
            _pin(needed, pinned)
