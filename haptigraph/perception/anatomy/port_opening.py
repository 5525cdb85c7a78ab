"""Find the port openings of the trocars just inside the wall, and their distance from its inner edge [px].

A port is drilled in the plane of the section, so the centre of its opening is on the section's circle. A rim
in front of that plane appears larger and leaves a gap to the opening.
"""

import math

import cv2
import numpy as np
from msgspec import Struct

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, Mask, colored
from haptigraph.messages import Image
from haptigraph.perception.anatomy.edge import Edge

__all__ = [
    "MAX_OPENINGS",
    "MIN_SEPARATION_DEG",
    "WHITE_GREY",
    "PortOpening",
    "find_port_openings",
    "polar_samples",
]

HALF_DEG = 80.0  # from the top
STEP_DEG = 0.25
# Ratios are relative to the radius of the inner edge.
BAND = (0.968, 0.992)  # where port openings are visible
BOWL = (0.92, 0.945)  # the bowl behind them: stains and print lines continue there, port openings do not
OPENING_DEG = 3.0
AROUND_DEG = 10.0
MIN_SEPARATION_DEG = 14.0
MIN_CONTRAST_RATIO = 4.5  # to the typical variation
MIN_RELATIVE_CONTRAST = 0.25  # to the strongest one: the openings of one eye look alike
WHITE_GREY = 250
"""Saturated where all colours reach it: a specular highlight or overexposure."""

MIN_CONTRAST_GREY = 4.0
SHADED_SD_DEG = 0.3  # of the middle of what is visible: an opening is lit from one side
MAX_OPENINGS = 3
MAX_DEPTH_RATIO = 0.05  # of an opening, inwards
PROFILE = (-0.08, 0.03)  # ratios, from the inner edge outwards
PROFILE_STEP_PX = 0.5
CENTER_DEG = 1.2
FLANK_DEG = (6.5, 10.0)
GAP_PX, GAP_BLUR = 0.8, 0.5  # an opening at least so far from the edge (in px, in blurs) is fully visible


class PortOpening(Struct, frozen=True):
    """One port opening."""

    angle_deg: float
    """From the top, positive to the image's right."""
    angle_sd_deg: float
    inside_px: float | None
    """Distance of its centre from the inner edge, inwards; None if the rim may occlude a part of it."""


def find_port_openings(reference: Image, edge: Edge) -> list[PortOpening]:
    """Return the port openings in the upper half, strongest contrast first.

    Args:
        reference: Frontal reference image without needle.
        edge: The wall's inner edge.
    """
    color = colored(reference)
    return [
        PortOpening(angle_deg, sd_deg, _inside_px(color, edge, angle_deg))
        for angle_deg, sd_deg in _angles_deg(color, edge)
    ]


def _angles_deg(color: Image, edge: Edge) -> list[tuple[float, float]]:
    """Return angles and their standard deviations: means, weighted with a contrast that varies by itself."""
    angles_deg = np.arange(-HALF_DEG - AROUND_DEG, HALF_DEG + AROUND_DEG + STEP_DEG, STEP_DEG)
    radii = edge.radii_px(math.pi - np.radians(angles_deg))[:, None]
    rings = (radii * np.linspace(*part, 9) for part in (BAND, BOWL))
    band, bowl = (polar_samples(color, edge.center_px, angles_deg, ring) for ring in rings)
    half = round(AROUND_DEG / STEP_DEG)
    tone = band.mean(axis=1) - bowl.mean(axis=1)
    around = np.array([np.median(tone[max(i - half, 0) : i + half + 1], axis=0) for i in range(len(tone))])
    window = np.ones(2 * round(OPENING_DEG / STEP_DEG / 2) + 1)  # odd, or it shifts by half a step
    deviation = cv2.blur(tone - around, (1, len(window)))
    contrast = _rms(deviation)
    typical = _typical(contrast)
    is_specular = np.maximum(band, bowl).min(axis=2).max(axis=1) >= WHITE_GREY
    contrast[(np.abs(angles_deg) > HALF_DEG) | (np.convolve(is_specular, window, "same") > 0)] = 0
    found: list[tuple[float, float]] = []
    min_contrast = max(MIN_CONTRAST_RATIO * typical, MIN_RELATIVE_CONTRAST * float(contrast.max()))
    while len(found) < MAX_OPENINGS and contrast.max() >= min_contrast:
        at = float(angles_deg[contrast.argmax()])
        near = np.abs(angles_deg - at) < MIN_SEPARATION_DEG / 2
        weight = contrast[near]
        mean_deg = float((angles_deg[near] * weight).sum() / weight.sum())
        lever_deg = math.sqrt(float(np.sum((angles_deg[near] - mean_deg) ** 2)) * OPENING_DEG / STEP_DEG)
        found.append((mean_deg, math.hypot(typical * lever_deg / float(weight.sum()), SHADED_SD_DEG)))
        contrast[np.abs(angles_deg - at) < MIN_SEPARATION_DEG] = 0
    return found


def _inside_px(color: Image, edge: Edge, angle_deg: float) -> float | None:
    """Return the distance of an opening's centre from the edge, midway between its half-contrast points."""
    angles_deg = angle_deg + np.arange(-FLANK_DEG[1], FLANK_DEG[1] + STEP_DEG / 2, STEP_DEG)
    offsets = np.arange(PROFILE[0] * edge.radius_px, PROFILE[1] * edge.radius_px, PROFILE_STEP_PX)
    radii = edge.radii_px(math.pi - np.radians(angles_deg))[:, None] + offsets
    samples = polar_samples(color, edge.center_px, angles_deg, radii)
    distance_deg = np.abs(angles_deg - angle_deg)
    flanks = samples[distance_deg > FLANK_DEG[0]].mean(axis=0)
    change = samples[distance_deg < CENTER_DEG].mean(axis=0) - flanks
    contrast = _rms(change)
    peak = int(contrast.argmax())
    if contrast[peak] < MIN_CONTRAST_RATIO * _typical(contrast):
        return None
    is_low = contrast < contrast[peak] / 2
    inner, outer = (_half_crossing(offsets, contrast, peak, is_low, step) for step in (-1, 1))
    if inner is None or outer is None or outer - inner > MAX_DEPTH_RATIO * edge.radius_px:
        return None
    if outer > -max(GAP_PX, GAP_BLUR * edge.blur_px):
        return None
    return -(inner + outer) / 2


def _rms(color: Floats) -> Floats:
    """Return the root mean square of three colours, (n,)."""
    return np.asarray(np.hypot(np.hypot(color[:, 0], color[:, 1]), color[:, 2]) / math.sqrt(3))


def _typical(contrast: Floats) -> float:
    return max(float(np.median(contrast)), MIN_CONTRAST_GREY / MIN_CONTRAST_RATIO)


def _half_crossing(offsets: Floats, contrast: Floats, peak: int, is_low: Mask, step: int) -> float | None:
    """Return the offset nearest to the peak, on one side, where the contrast falls to half."""
    at = peak
    while not is_low[at]:
        at += step
        if not 0 <= at < len(contrast):
            return None
    before = at - step
    share = (contrast[before] - contrast[peak] / 2) / (contrast[before] - contrast[at])
    return float(offsets[before] + share * (offsets[at] - offsets[before]))


def polar_samples(image: Image, center_px: Vec, angles_deg: Floats, radii_px: Floats) -> Floats:
    """Sample an image about a centre.

    Args:
        image: (h, w, 3) or (h, w).
        center_px: The centre.
        angles_deg: From the top, positive to the image's right, (n,).
        radii_px: (m,), or (n, m) if they differ from angle to angle.

    Returns:
        (n, m, 3), or (n, m) of a grey image.
    """
    angles = np.radians(angles_deg)[:, None]
    x = (center_px[0] + radii_px * np.sin(angles)).astype(np.float32)
    y = (center_px[1] - radii_px * np.cos(angles)).astype(np.float32)
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR), np.float64)
