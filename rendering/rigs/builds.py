"""The rigs of a comparison: number 0 as designed, the others drawn from the tolerances. Needs no Blender."""

from pathlib import Path

import numpy as np
from msgspec.structs import replace

from haptigraph.rig.description import Rig
from haptigraph.rig.view import Build, as_designed, drawn

__all__ = ["build_of", "picture_file"]

SEED, MOST = 7, 100


def build_of(rig: Rig, number: int) -> Build:
    """Return one rig as built, up to number 100.

    Ports and target are where the globe's size puts them; it is one mesh.
    """
    if number == 0:
        return as_designed()
    build = drawn(rig, MOST, SEED).row(number - 1)
    scale = build.radius_mm / (rig.eye.diameter_mm / 2)
    return replace(build, cut_mm=rig.eye.cut_mm * scale, along_mm=np.zeros((1, 3)))


def picture_file(folder: Path, number: int) -> Path:
    """Return the file of a rig's picture."""
    return folder / f"{number:03d}.png"
