"""Rays from the eye's section by the mirror to the camera's pupil, and along instruments in the ports."""

import numpy as np
import trimesh
from numpy.typing import NDArray

from rig.layout import Layout
from rig.parts.eye import PORT_WALL_MM
from rig.parts.mirror_mount import LIP_MM

__all__ = ["faults_of", "instrument_faults", "section_points"]

RINGS, SPOKES = 6, 72
START_MM = 0.05
"""In front of the cut face, where rays start."""
SWING_DEG = 10.0
"""To either side of the line from the target through the port, that instruments need."""
SHAFT_MM = (3.5, 60.0)
"""The part of an instrument outside the port that must be free."""
SHAFT_RADIUS_MM = 0.6

Points = NDArray[np.float64]


def section_points(layout: Layout) -> Points:
    """Return points of the cut face (n, 3): the globe and its wall, except the ports, which rise above it."""
    radii = np.linspace(0.1, layout.bulge_mm - 0.1, RINGS)
    angles = np.linspace(0, 2 * np.pi, SPOKES, endpoint=False)
    x = np.outer(radii, np.cos(angles)).ravel()
    y = np.outer(radii, np.sin(angles)).ravel()
    points = np.column_stack([x, y, np.full(len(x), layout.rig.eye.cut_mm + START_MM)])
    beside_mm = layout.rig.eye.port_mm / 2 + PORT_WALL_MM + START_MM
    is_port = np.zeros(len(points), bool)
    for angle_deg in layout.rig.eye.trocars_deg:
        out = layout.on_globe(angle_deg, 1.0)
        is_port |= (np.abs(out[0] * y - out[1] * x) < beside_mm) & (points @ out > 0)
    return points[~is_port | (np.hypot(x, y) < layout.radius_mm - START_MM)]


def faults_of(layout: Layout, meshes: dict[str, trimesh.Trimesh]) -> list[str]:
    """Return what is between the section and the camera, and whether the mirror is too small.

    Args:
        layout: The layout.
        meshes: All bodies by name, in the eye frame.
    """
    start, faults = section_points(layout), []
    legs = [(start, _front(layout, start))]
    if layout.mirror:
        corner, off_mm = _on_mirror(layout, start)
        if off_mm.max() > 0:
            faults.append(
                f"the mirror is too small: {np.mean(off_mm > 0):.0%} of the rays from the eye "
                f"miss it, by up to {off_mm.max():.1f} mm"
            )
        legs = [(start, corner), (corner, _front(layout, corner))]
    obstacles = {name: mesh for name, mesh in meshes.items() if name not in ("camera", "mirror")}
    blocked: dict[str, set[int]] = {}
    for begin, end in legs:
        for name, rays in _hits(obstacles, begin, end).items():
            blocked.setdefault(name, set()).update(rays)
    return faults + [
        f"{name} is between the section and the camera: it blocks {len(rays) / len(start):.0%} of the rays"
        for name, rays in sorted(blocked.items())
    ]


def instrument_faults(layout: Layout, meshes: dict[str, trimesh.Trimesh]) -> list[str]:
    """Return what is in the way of instruments that go through a port to the target."""
    target = layout.on_globe(180 - layout.rig.eye.target_deg)
    faults = []
    for number, angle_deg in enumerate(layout.rig.eye.trocars_deg, 1):
        port = layout.on_globe(angle_deg)
        way = (port - target) / np.linalg.norm(port - target)
        swings = np.radians(np.linspace(-SWING_DEG, SWING_DEG, 9))
        ways = np.array([_turned(way, swing) for swing in swings for _ in (-1, 0, 1)])
        aside = np.array([0, 0, SHAFT_RADIUS_MM]) * np.tile([[-1], [0], [1]], (len(swings), 1))
        reach = layout.outer_mm - layout.radius_mm + SHAFT_MM[0]
        hits = _hits(meshes, port + reach * ways + aside, port + SHAFT_MM[1] * ways + aside)
        faults += [
            f"{name} is in the way of an instrument in port {number} that swings by {SWING_DEG:g}°"
            for name in sorted(hits)
        ]
    return faults


def _front(layout: Layout, start: Points) -> Points:
    """Return where rays from somewhere to the pupil pass the plane of the camera's front face."""
    pose = layout.camera
    way = pose.pupil_mm - start
    share = ((pose.front_mm - start) @ pose.look) / (way @ pose.look)
    return start + share[:, None] * way


def _on_mirror(layout: Layout, start: Points) -> tuple[Points, Points]:
    """Return where rays meet the mirror's plane, and how far outside its free face."""
    middle, slope = layout.mirror_center_mm, 0.5**0.5
    normal, up = np.array([0, slope, slope]), np.array([0, slope, -slope])
    virtual = layout.rig.path_mm * np.array([0, 0, 1.0])  # the pupil, unfolded
    way = virtual - start
    share = ((middle - start) @ normal) / (way @ normal)
    corner = start + share[:, None] * way
    width, length = layout.rig.mirrors[0].size_mm
    x_off = np.abs(corner[:, 0]) - (width / 2 - LIP_MM)
    up_off = np.abs((corner - middle) @ up) - length / 2
    return corner, np.maximum(np.maximum(x_off, up_off), 0)


def _hits(obstacles: dict[str, trimesh.Trimesh], start: Points, end: Points) -> dict[str, set[int]]:
    """Return by obstacle which of the segments it blocks."""
    way = end - start
    length = np.linalg.norm(way, axis=1)
    found = {}
    for name, mesh in obstacles.items():
        _, ray, where = mesh.ray.intersects_id(
            start, way / length[:, None], multiple_hits=False, return_locations=True
        )
        if not len(ray):
            continue
        near = np.linalg.norm(where - start[ray], axis=1) < length[ray] - START_MM
        if near.any():
            found[name] = set(np.asarray(ray)[near].tolist())
    return found


def _turned(way: Points, angle_rad: float) -> Points:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([cos * way[0] - sin * way[1], sin * way[0] + cos * way[1], way[2]])
