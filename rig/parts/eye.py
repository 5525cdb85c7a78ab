"""The eye: a bowl cut open in front of the section, with two ports, a seat for the retina, a boss behind."""

import math

from build123d import Part, Plane

from rig.layout import Layout
from rig.shapes import Range, ball, block, rod, slab
from rig.standard import INSERT_DEPTH_MM, INSERT_MM, PRESS_MM, SLIDE_MM, Print

__all__ = [
    "PEG_MM",
    "PORT_WALL_MM",
    "PRINT",
    "boss_mm",
    "build",
    "in_front",
    "inserts_mm",
    "peg_mm",
    "target_plane",
    "target_slot",
]

PRINT = Print(
    up=(0, 0, 1),
    lies_on="the back of its boss; the cut face is up",
    color="white, matt",
    layer_mm=0.12,
    note="Ream the ports with a drill of their diameter.",
)
FAR_MM = 100.0
PEG_MM = 3.0
"""Diameter of the retina shell's peg."""
PORT_WALL_MM, PORT_LENGTH_MM = 1.4, 2.5
BACK_WALL_MM = 1.8


def build(layout: Layout) -> Part:
    """Return the eye."""
    eye, radius = layout.rig.eye, layout.radius_mm
    ledge_mm = layout.retina_edge_mm + SLIDE_MM
    body = ball(layout.outer_mm) + (ball(layout.bulge_mm) & _below(ledge_mm + eye.wall_mm))
    body += rod((0, 0, layout.back_mm), (0, 0, -1), 2 * boss_mm(layout))
    body &= in_front(eye.cut_mm)
    for angle_deg in eye.trocars_deg:
        out = layout.on_globe(angle_deg, 1.0)
        end_mm = layout.outer_mm + PORT_LENGTH_MM
        body += rod((radius - 1) * out, end_mm * out, eye.port_mm + 2 * PORT_WALL_MM)
    rim_mm = math.sqrt(radius**2 - eye.cut_mm**2)
    body -= ball(radius) + rod((0, 0, eye.cut_mm), (0, 0, FAR_MM), 2 * rim_mm)
    seat_mm = radius + eye.retina_mm + SLIDE_MM
    seat = ball(seat_mm) + rod((0, 0, 0), (0, 0, FAR_MM), 2 * seat_mm)  # the shell slides out to the front
    body -= seat & _below(ledge_mm)
    for angle_deg in eye.trocars_deg:
        out = layout.on_globe(angle_deg, 1.0)
        body -= rod((radius - 2) * out, (layout.bulge_mm + 9) * out, eye.port_mm)
    for x_mm in inserts_mm(layout):
        body -= rod((x_mm, 0, layout.back_mm), (x_mm, 0, layout.back_mm + INSERT_DEPTH_MM - 1), INSERT_MM)
    x_mm, y_mm = 0.0, peg_mm(layout)
    body -= rod((x_mm, y_mm, layout.back_mm), (x_mm, y_mm, 0), PEG_MM + 2 * SLIDE_MM)
    return body - target_slot(layout, PRESS_MM)


def boss_mm(layout: Layout) -> float:
    """Return the radius of the boss; outside it the bowl rises at more than 45 degrees."""
    return 0.75 * layout.bulge_mm


def inserts_mm(layout: Layout) -> tuple[float, float]:
    """Return x of the two inserts that hold the eye to its frame."""
    x_mm = boss_mm(layout) - INSERT_MM / 2 - BACK_WALL_MM
    return -x_mm, x_mm


def peg_mm(layout: Layout) -> float:
    """Return y of the retina shell's peg."""
    return -0.5 * layout.bulge_mm


def in_front(z_mm: float) -> Part:
    """Return all space behind a plane in front of the section."""
    return block((-FAR_MM, FAR_MM), (-FAR_MM, FAR_MM), (-FAR_MM, z_mm))


def target_slot(layout: Layout, play_mm: float) -> Part:
    """Return the slot of the target's pin: radial, open towards the camera."""
    half = layout.rig.eye.target_mm / 2
    low, high = layout.radius_mm - 1, layout.bulge_mm + 10
    return slab(
        target_plane(layout),
        (-half - play_mm, half + play_mm),
        (-half - play_mm, layout.rig.eye.cut_mm + 1),
        (low, high),
    )


def target_plane(layout: Layout) -> Plane:
    """Return the target's coordinates: along the retina, towards the camera, away from the eye's centre."""
    angle = math.radians(layout.rig.eye.target_deg)
    return Plane(
        origin=(0, 0, 0),
        x_dir=(math.cos(angle), math.sin(angle), 0),
        z_dir=(math.sin(angle), -math.cos(angle), 0),
    )


def _below(y_mm: float) -> Part:
    everywhere: Range = (-FAR_MM, FAR_MM)
    return block(everywhere, (-FAR_MM, y_mm), everywhere)
