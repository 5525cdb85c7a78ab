"""Bodies against each other: none overlap, fits have their play, joints touch, all others are apart."""

from collections.abc import Iterable
from itertools import combinations

import numpy as np
import trimesh
from msgspec import Struct

from rig.assembly import Body
from rig.meshes import solid_of
from rig.parts import clip
from rig.standard import PRESS_MM, SLIDE_MM

__all__ = ["APART_MM", "Gap", "faults_of", "gaps_of"]

APART_MM = 0.3
"""Least distance of bodies that have nothing to do with each other."""
ACCURACY_MM = 0.04
"""Of a measured play: two meshes, each up to a chord's height away from its surface."""
MAX_OVERLAP_MM3 = 0.05
SEARCH_MM = 2.0

FITS = {
    ("eye", "retina"): SLIDE_MM,
    ("eye", "target"): PRESS_MM,
    ("retina", "target"): PRESS_MM,
    ("camera", "camera_mount"): SLIDE_MM,
    ("camera", "camera_clamp"): SLIDE_MM,
    ("mirror", "mirror_mount"): SLIDE_MM,
    ("mask", "post"): SLIDE_MM,
    ("led", "light"): SLIDE_MM,
    ("clip", "motor"): PRESS_MM,
    ("clip", "stylus"): clip.PLAY_MM,
}
"""Play on every side, by pairs of kinds in alphabetical order."""
JOINTS = {
    ("base", "frame"),
    ("base", "camera_mount"),
    ("base", "light"),
    ("base", "mirror_mount"),
    ("base", "post"),
    ("eye", "frame"),
    ("camera_clamp", "camera_mount"),
}
"""Pairs that are screwed face to face."""


class Gap(Struct, frozen=True):
    """Two bodies that are near each other."""

    names: tuple[str, str]
    kind: str
    """"fit", "joint", "screw" or "apart"."""
    wanted_mm: float
    gap_mm: float
    """Distance; 0: they touch."""
    overlap_mm3: float

    @property
    def fault(self) -> str:
        """What is wrong, in a sentence; empty: nothing."""
        pair, gap = " and ".join(self.names), f"{self.gap_mm:.2f} mm"
        if self.overlap_mm3 > MAX_OVERLAP_MM3:
            return f"{pair} overlap by {self.overlap_mm3:.2f} mm³; they must not overlap"
        if self.kind == "fit" and abs(self.gap_mm - self.wanted_mm) > ACCURACY_MM:
            return f"the play between {pair} is {gap}; it must be {self.wanted_mm:.2f} mm"
        if self.kind == "joint" and self.gap_mm > ACCURACY_MM:
            return f"{pair} are {gap} apart; they must touch where they are screwed together"
        if self.kind == "apart" and self.gap_mm < self.wanted_mm:
            return f"{pair} are {gap} apart; at least {self.wanted_mm:.1f} mm are needed"
        return ""


def gaps_of(bodies: Iterable[Body], meshes: dict[str, trimesh.Trimesh], board: bool) -> list[Gap]:
    """Measure every pair of bodies of one assembly that should or may be near each other.

    Args:
        bodies: The bodies.
        meshes: Their meshes by name, in the eye frame.
        board: Whether the camera is a bare board, which is screwed to its mount.
    """
    solids = {name: solid_of(mesh) for name, mesh in meshes.items()}
    gaps = []
    for first, second in combinations(sorted(bodies, key=lambda body: body.name), 2):
        if first.group != second.group:
            continue
        kinds = tuple(sorted((first.kind, second.kind)))
        kind, wanted_mm = _relation(kinds, board)
        near = _boxes_near(meshes[first.name], meshes[second.name])
        if not near and kind in ("apart", "screw"):
            continue
        one, other = solids[first.name], solids[second.name]
        overlap = (one ^ other).volume()
        gap = 0.0 if overlap > MAX_OVERLAP_MM3 else one.min_gap(other, SEARCH_MM)
        gaps.append(Gap((first.name, second.name), kind, wanted_mm, gap, overlap))
    return gaps


def faults_of(gaps: Iterable[Gap]) -> list[str]:
    """Return a sentence for everything that does not fit."""
    return [gap.fault for gap in gaps if gap.fault]


def _relation(kinds: tuple[str, ...], board: bool) -> tuple[str, float]:
    if "screw" in kinds:
        return "screw", 0.0
    if kinds in JOINTS or (board and kinds == ("camera", "camera_mount")):
        return "joint", 0.0
    if kinds in FITS:
        return "fit", FITS[kinds]  # type: ignore[index]
    return "apart", APART_MM


def _boxes_near(first: trimesh.Trimesh, second: trimesh.Trimesh) -> bool:
    (low, high), (other_low, other_high) = first.bounds, second.bounds
    return bool(np.all(low - APART_MM <= other_high) and np.all(other_low - APART_MM <= high))
