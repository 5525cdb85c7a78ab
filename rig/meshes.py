"""Solids -> triangle meshes, as a printer gets them, in the eye frame or as they lie on the bed [mm]."""

import manifold3d
import numpy as np
import trimesh
from build123d import Part
from numpy.typing import NDArray

from rig.standard import Print

__all__ = ["CHORD_SHARE", "bed_axes", "mesh_of", "on_bed", "solid_of"]

CHORD_SHARE = 0.001
"""How far a mesh may be from the true surface, relative to the size of an edge."""
ANGLE_RAD = 0.1
MERGE_DIGITS = 5  # faces that meet in an edge are triangulated one by one


def mesh_of(shape: Part) -> trimesh.Trimesh:
    """Return the surface of a solid, triangles (n, 3), normals outwards."""
    points, triangles = shape.tessellate(CHORD_SHARE, ANGLE_RAD)
    mesh = trimesh.Trimesh(np.array([tuple(point) for point in points]), np.array(triangles))
    mesh.merge_vertices(digits_vertex=MERGE_DIGITS)
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    return mesh


def solid_of(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """Return a mesh as a solid that can be intersected and measured."""
    return manifold3d.Manifold(
        manifold3d.Mesh64(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.uint64))
    )


def on_bed(mesh: trimesh.Trimesh, print_: Print) -> trimesh.Trimesh:
    """Return a copy as it is printed: z up, on z = 0, around the z axis."""
    turned, turn = mesh.copy(), np.eye(4)
    turn[:3, :3] = bed_axes(print_)
    turned.apply_transform(turn)
    low, high = turned.bounds
    turned.apply_translation([-(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]])
    return turned


def bed_axes(print_: Print) -> NDArray[np.float64]:
    """Return the bed's x, y and z (up) as rows in the eye frame; x is the eye frame's, or its z."""
    up = np.array(print_.up, float) / np.linalg.norm(print_.up)
    across = np.array([1.0, 0, 0]) if abs(up[0]) < 0.9 else np.array([0, 0, 1.0])
    return np.array([across, np.cross(up, across), up])
