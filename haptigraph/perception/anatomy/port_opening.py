"""Find the port_openings of the trocar holes just inside the wall, and how far inside each one lies [px].

A hole is drilled in the section's plane, so the middle of its mouth lies on the section's circle; a rim that
stands before that plane is seen larger, and leaves a gap to the mouth. Knows no needle and no millimetres.
"""

import math

import cv2
import numpy as np
from msgspec import Struct

from haptigraph.imaging import Floats, Mask, colored
from haptigraph.messages import Image
from haptigraph.perception.anatomy.edge import Edge

__all__ = ["APART_DEG", "MOST_OPENINGS", "WHITE_GREY", "PortOpening", "find_port_openings"]

HALF_DEG = 80.0  # from the top
STEP_DEG = 0.25
BAND = (0.968, 0.992)  # of the inner edge's radius, where port_openings are seen
BOWL = (0.92, 0.945)  # and where the bowl behind them is: stains and print lines go on, port_openings do not
WIDE_DEG = 3.0
AROUND_DEG = 10.0
APART_DEG = 14.0
CLEAR = 4.5  # times the usual variation
ALIKE = 0.25  # of the clearest one's contrast: holes of one eye look alike
WHITE_GREY = 250
"""Where all colours reach it, the camera sees no colour: a reflection, or too much light."""

LEAST_GREY = 4.0
MOST_OPENINGS = 3
THICKEST = 0.05  # of the radius: what reaches further inwards is no mouth
PROFILE = (-0.08, 0.03)  # of the radius, from the inner edge outwards
PROFILE_STEP_PX = 0.5
MIDDLE_DEG = 1.2
BESIDE_DEG = (6.5, 10.0)
GAP_PX, GAP_BLUR = 0.8, 0.5  # a mouth so far off the edge, or so many times its blur, is seen whole


class PortOpening(Struct, frozen=True):
    """One mouth."""

    angle_deg: float
    """From the top, positive to the image's right."""
    inside_px: float | None
    """How far inside the inner edge its middle lies; None: it is not seen whole, the rim may hide a part."""


def find_port_openings(still: Image, edge: Edge) -> list[PortOpening]:
    """Return the port_openings in the upper half, clearest first.

    Args:
        still: The picture without needle.
        edge: The wall's inner edge.
    """
    color = colored(still)
    return [PortOpening(angle, _inside_px(color, edge, angle)) for angle in _angles_deg(color, edge)]


def _angles_deg(color: Image, edge: Edge) -> list[float]:
    angles_deg = np.arange(-HALF_DEG - AROUND_DEG, HALF_DEG + AROUND_DEG + STEP_DEG, STEP_DEG)
    radii = edge.radii_px(math.pi - np.radians(angles_deg))[:, None]
    band, bowl = (_unrolled(color, edge, angles_deg, radii * np.linspace(*part, 9)) for part in (BAND, BOWL))
    half = round(AROUND_DEG / STEP_DEG)
    tone = band.mean(axis=1) - bowl.mean(axis=1)
    around = np.array([np.median(tone[max(i - half, 0) : i + half + 1], axis=0) for i in range(len(tone))])
    away = cv2.blur(tone - around, (1, round(WIDE_DEG / STEP_DEG)))
    size = np.hypot(np.hypot(away[:, 0], away[:, 1]), away[:, 2]) / math.sqrt(3)
    usual = max(float(np.median(size)), LEAST_GREY / CLEAR)
    glints = np.maximum(band, bowl).min(axis=2).max(axis=1) >= WHITE_GREY
    reach = np.ones(round(WIDE_DEG / STEP_DEG))
    size[(np.abs(angles_deg) > HALF_DEG) | (np.convolve(glints, reach, "same") > 0)] = 0
    found: list[float] = []
    least = max(CLEAR * usual, ALIKE * float(size.max()))
    while len(found) < MOST_OPENINGS and size.max() >= least:
        at = float(angles_deg[size.argmax()])
        weight = size * (np.abs(angles_deg - at) < APART_DEG / 2)
        found.append(float((angles_deg * weight).sum() / weight.sum()))
        size[np.abs(angles_deg - at) < APART_DEG] = 0
    return found


def _inside_px(color: Image, edge: Edge, angle_deg: float) -> float | None:
    """Return where the mouth's middle lies, between the places where half of its contrast is seen."""
    angles_deg = angle_deg + np.arange(-BESIDE_DEG[1], BESIDE_DEG[1] + STEP_DEG / 2, STEP_DEG)
    places = np.arange(PROFILE[0] * edge.radius_px, PROFILE[1] * edge.radius_px, PROFILE_STEP_PX)
    radii = edge.radii_px(math.pi - np.radians(angles_deg))[:, None] + places
    unrolled = _unrolled(color, edge, angles_deg, radii)
    apart_deg = np.abs(angles_deg - angle_deg)
    change = unrolled[apart_deg < MIDDLE_DEG].mean(axis=0) - unrolled[apart_deg > BESIDE_DEG[0]].mean(axis=0)
    size = np.hypot(np.hypot(change[:, 0], change[:, 1]), change[:, 2]) / math.sqrt(3)
    top = int(size.argmax())
    if size[top] < CLEAR * max(float(np.median(size)), LEAST_GREY / CLEAR):
        return None
    is_low = size < size[top] / 2
    inner, outer = _crossing(places, size, top, is_low, -1), _crossing(places, size, top, is_low, 1)
    if inner is None or outer is None or outer - inner > THICKEST * edge.radius_px:
        return None
    if outer > -max(GAP_PX, GAP_BLUR * edge.blur_px):
        return None
    return -(inner + outer) / 2


def _crossing(places: Floats, size: Floats, top: int, is_low: Mask, step: int) -> float | None:
    """Return the place nearest to the top, on one side, where its half is crossed."""
    at = top
    while not is_low[at]:
        at += step
        if not 0 <= at < len(size):
            return None
    before = at - step
    share = (size[before] - size[top] / 2) / (size[before] - size[at])
    return float(places[before] + share * (places[at] - places[before]))


def _unrolled(color: Image, edge: Edge, angles_deg: Floats, radii_px: Floats) -> Floats:
    """Return colours at angles from the top and radii, (n, m, 3)."""
    angles = np.radians(angles_deg)[:, None]
    x = (edge.center_px[0] + radii_px * np.sin(angles)).astype(np.float32)
    y = (edge.center_px[1] - radii_px * np.cos(angles)).astype(np.float32)
    return np.asarray(cv2.remap(color, x, y, cv2.INTER_LINEAR), np.float64)
