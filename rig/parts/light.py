"""The light: a ring of 5 mm LEDs that look at the eye, on two legs; open at the top, for instruments."""

import math

import numpy as np
from build123d import Part

from rig.feet import feet_of
from rig.layout import LEG_MM, Layout
from rig.shapes import block, rod
from rig.standard import INSERT_DEPTH_MM, INSERT_MM, LED_MM, Print

__all__ = ["LEDS", "PRINT", "build", "led", "led_axes"]

PRINT = Print(up=(0, 0, 1), lies_on="the face away from the camera, flat", infill_percent=40)
LEDS = 8
"""How many."""
HALF_DEPTH_MM, HALF_BAND_MM = 5.5, 5.0
END_DEG = 12.0
"""How far the ring rises above its middle on both sides."""
AIM_MM = 3.0
"""In front of the section: where the LEDs' axes meet."""


def build(layout: Layout) -> Part:
    """Return the holder."""
    light = layout.rig.light
    radius, z = light.diameter_mm / 2, light.from_section_mm
    depth = (z - HALF_DEPTH_MM, z + HALF_DEPTH_MM)
    top = radius * math.sin(math.radians(END_DEG)) + HALF_BAND_MM
    ends = (0, 0, depth[0]), (0, 0, depth[1])
    ring = rod(*ends, 2 * (radius + HALF_BAND_MM)) - rod(*ends, 2 * (radius - HALF_BAND_MM))
    holder = ring & block((-200, 200), (-200, top), depth)
    for side in (-1, 1):
        leg = sorted((side * (layout.leg_mm - LEG_MM / 2), side * (layout.leg_mm + LEG_MM / 2)))
        arm = sorted((side * radius, side * (layout.leg_mm + LEG_MM / 2)))
        holder += block(tuple(leg), (layout.base_mm, top), depth)
        holder += block(tuple(arm), (top - 9, top), depth)
    for start, end in led_axes(layout):
        holder -= rod(start, end, LED_MM)
    for x_mm, z_mm in feet_of(layout)["light"]:
        base = layout.base_mm
        holder -= rod((x_mm, base, z_mm), (x_mm, base + INSERT_DEPTH_MM, z_mm), INSERT_MM)
    return holder


def led_axes(layout: Layout) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the two ends of each LED's hole, the outer one first."""
    light, axes = layout.rig.light, []
    for share in (np.arange(LEDS) + 0.5) / LEDS:
        angle = math.radians(-180 + share * 180)
        center = np.array([math.cos(angle), math.sin(angle), 0]) * light.diameter_mm / 2
        center[2] = light.from_section_mm
        way = np.array([0, 0, AIM_MM]) - center
        way /= np.linalg.norm(way)
        axes.append((center - 8 * way, center + 8 * way))
    return axes


def led(outer: np.ndarray, inner: np.ndarray) -> Part:
    """Return an LED in its hole: 5 mm wide, with a round end."""
    way = (inner - outer) / np.linalg.norm(inner - outer)
    start = outer + 5 * way
    return rod(start, start + 6.0 * way, 4.7)
