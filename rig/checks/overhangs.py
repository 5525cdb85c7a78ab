"""A part as it lies on the bed -> its overhangs beyond 45 degrees; wide ones need supports."""

import numpy as np
import trimesh
from msgspec import Struct

from rig.meshes import on_bed
from rig.standard import Print

__all__ = ["BRIDGE_MM", "Overhang", "faults_of", "overhangs_of"]

BRIDGE_MM = 8.0
"""Narrower ones print as bridges or short ledges."""
LIMIT = -(0.5**0.5) - 2e-3
"""z of the normal: 45 degrees, and the angle of a mesh's facets."""
ON_BED_MM = 0.05
SMALL_MM2 = 1.0
TURNS = 36


class Overhang(Struct, frozen=True):
    """One connected area."""

    area_mm2: float
    width_mm: float
    """Its smallest width, seen from above."""
    height_mm: float
    """Above the bed."""


def overhangs_of(mesh: trimesh.Trimesh, print_: Print) -> list[Overhang]:
    """Return all overhangs of at least a square millimetre, the widest first."""
    lying = on_bed(mesh, print_)
    hanging = (lying.face_normals[:, 2] < LIMIT) & (lying.triangles[:, :, 2].max(axis=1) > ON_BED_MM)
    pairs = lying.face_adjacency[hanging[lying.face_adjacency].all(axis=1)]
    groups = trimesh.graph.connected_components(pairs, nodes=np.flatnonzero(hanging))
    found = [_overhang(lying, np.asarray(group)) for group in groups]
    return sorted((one for one in found if one.area_mm2 >= SMALL_MM2), key=lambda one: -one.width_mm)


def faults_of(name: str, overhangs: list[Overhang], print_: Print) -> list[str]:
    """Return whether a part that is printed without supports needs some."""
    wide = [one for one in overhangs if one.width_mm > BRIDGE_MM]
    if print_.supports or not wide:
        return []
    return [
        f"{name}: {len(wide)} overhangs beyond 45°, up to {wide[0].width_mm:.1f} mm wide, "
        f"{wide[0].height_mm:.1f} mm above the bed; without supports, {BRIDGE_MM:g} mm is the limit"
    ]


def _overhang(mesh: trimesh.Trimesh, faces: np.ndarray) -> Overhang:
    corners = mesh.triangles[faces].reshape(-1, 3)
    angles = np.arange(TURNS) * np.pi / TURNS
    across = corners[:, :2] @ np.array([np.cos(angles), np.sin(angles)])
    return Overhang(
        area_mm2=float(mesh.area_faces[faces].sum()),
        width_mm=float(np.ptp(across, axis=0).min()),
        height_mm=float(corners[:, 2].min()),
    )
