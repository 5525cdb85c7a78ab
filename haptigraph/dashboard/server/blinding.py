"""What a blinded page receives of a run: the picture, and nothing that a study's condition decides.

Rules, states, zones, measures, haptic output and the faults of the device differ between conditions; the
source, the hand that steers, and the health of loop and recorder do not.
"""

from collections.abc import Mapping
from typing import Any

from msgspec.structs import replace

from haptigraph.dashboard.server.protocol import ImageHeader

__all__ = ["blind_health", "blind_hello", "blind_image"]

NO_PROCEDURE = {"name": "", "title": "", "sha256": "", "entities": [], "relations": [], "states": []}
SHARED_FAULTS = ("source", "perceiver", "recorder")
"""Where faults occur under any condition."""


def blind_hello(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a run's first message without procedure and anatomy."""
    return {**fields, "procedure": {**NO_PROCEDURE, "patterns": []}, "anatomy": {}}


def blind_image(header: ImageHeader) -> ImageHeader:
    """Return the header of an image without what was found in it and what followed."""
    return replace(
        header,
        state="",
        because="",
        feel="",
        plays="",
        forces=(),
        evidence=(),
        nodes=(),
        edges=(),
        measures={},
        found={},
        beside=(),
        sd_mm={},
        in_space="",
        faults=tuple(fault for fault in header.faults if fault.startswith(SHARED_FAULTS)),
    )


def blind_health(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a health message without broken claims and the faults of the device."""
    faults = {where: fault for where, fault in fields.get("faults", {}).items() if where in SHARED_FAULTS}
    return {**fields, "faults": faults, "broken": []}
