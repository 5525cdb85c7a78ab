"""A printed part's mesh: closed, in one piece, within the bed, with walls that a printer can make."""

import manifold3d
import numpy as np
import trimesh

from rig.meshes import on_bed, solid_of
from rig.standard import BED_MM, Print

__all__ = ["bed_faults", "thinnest_mm", "wall_faults", "watertight_faults"]

SAMPLES, SEED = 6000, 20
OPPOSITE = -0.8
"""Cosine between the two faces of a wall; edges where faces meet at an angle are not walls."""
MAX_THIN_MM2 = 0.5
ACCURACY_MM = 0.03
INSIDE_MM = 1e-3


def watertight_faults(name: str, mesh: trimesh.Trimesh) -> list[str]:
    """Return what is wrong with a surface: open, inside out, or in several pieces."""
    if not mesh.is_watertight or solid_of(mesh).status() != manifold3d.Error.NoError:
        return [f"{name}: its surface is not closed; a printer needs a watertight mesh"]
    if mesh.volume <= 0 or not mesh.is_winding_consistent:
        return [f"{name}: its surface is inside out; normals must point outwards"]
    pieces = mesh.body_count
    return [f"{name}: it is in {pieces} pieces; a part must be one"] if pieces != 1 else []


def bed_faults(name: str, mesh: trimesh.Trimesh, print_: Print) -> list[str]:
    """Return whether a part is too large for a common printer."""
    size = on_bed(mesh, print_).extents
    width, depth = sorted(size[:2])
    if width <= min(BED_MM[:2]) and depth <= max(BED_MM[:2]) and size[2] <= BED_MM[2]:
        return []
    found, limit = (" x ".join(f"{side:.0f}" for side in sides) for sides in (size, BED_MM))
    return [f"{name}: {found} mm as printed; the bed takes {limit} mm"]


def wall_faults(name: str, mesh: trimesh.Trimesh, print_: Print) -> list[str]:
    """Return whether a part has walls thinner than its smallest printable one."""
    thickness = _thickness_mm(mesh)
    thin = thickness < print_.min_wall_mm - ACCURACY_MM
    area_mm2 = float(thin.mean() * mesh.area)
    if area_mm2 <= MAX_THIN_MM2:
        return []
    return [
        f"{name}: {area_mm2:.1f} mm² of wall is thinner than {print_.min_wall_mm:g} mm, "
        f"down to {thickness.min():.2f} mm"
    ]


def thinnest_mm(mesh: trimesh.Trimesh) -> float:
    """Return the thickness that only a thousandth of the surface undercuts."""
    return float(np.quantile(_thickness_mm(mesh), 0.001))


def _thickness_mm(mesh: trimesh.Trimesh) -> np.ndarray:
    """Return the wall's thickness at random points, infinite where the opposite face is not parallel."""
    points, faces = trimesh.sample.sample_surface(mesh, SAMPLES, seed=SEED)
    inwards = -mesh.face_normals[faces]
    origins = points + INSIDE_MM * inwards
    hit, ray, where = mesh.ray.intersects_id(origins, inwards, multiple_hits=False, return_locations=True)
    thickness = np.full(len(points), np.inf)
    facing = np.einsum("ij,ij->i", mesh.face_normals[hit], mesh.face_normals[faces[ray]])
    wall = facing < OPPOSITE
    thickness[ray[wall]] = np.linalg.norm(where[wall] - points[ray[wall]], axis=1)
    return thickness
