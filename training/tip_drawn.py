"""Drawn windows along shafts: random needles, lights and grounds -> windows with their true tips.

Rendered scenes are few, and simulated needles look alike. These vary what a window shows one by one: width,
point, brightness across and along the shaft, highlight and rims, blur, noise, colour, ground and shadow.
"""

import cv2
import numpy as np
from numpy.random import Generator

from haptigraph.imaging import Floats
from haptigraph.perception.native.strip import STATION_PX
from haptigraph.perception.native.tip_network import STATIONS, VALUES
from training.tip_shape import ACROSS, BEHIND, CHANNELS, LANE_MM, STEP_MM
from training.tip_windows import NEAR_MM, WIDE_MM, Window, Windows

__all__ = ["drawn"]

FINE = 3  # samples per lane and station
U_MM = np.arange(STATIONS * FINE) / FINE * STEP_MM - BEHIND * STEP_MM
V_MM = (np.arange(ACROSS * FINE) / FINE - (ACROSS - 1 / FINE) / 2)[:, None] * LANE_MM
WIDTH_MM, TAPER_MM, BEVEL_MM = (0.25, 1.0), (0.3, 6.0), (0.4, 2.0)
GREY, NOISE_GREY = (12.0, 90.0), (0.5, 10.0)
BLUR_MM, PX_PER_MM = (0.02, 0.12), (4.5, 30.0)
MAX_OFF_MM = 0.04  # of the shaft from the middle of the window
WIDE_SHARE = 0.25  # of tips that are further from the window's place
COLORS, TINT_SHARE = (0.0, 0.3, 1.0), 0.3  # how coloured a needle is, and how often unevenly
LEFT_SHARE = 0.3  # of the ground, at most, that is left when the background is subtracted


def drawn(count: int, seed: int) -> Windows:
    """Return random windows."""
    rng = np.random.default_rng(seed)
    return Windows.of(_window(rng) for _ in range(count))


def _window(rng: Generator) -> Window:
    is_wide = rng.random() < WIDE_SHARE
    tip_mm = -rng.uniform(*WIDE_MM) if is_wide else rng.uniform(-NEAR_MM, NEAR_MM)
    off_mm = rng.normal(0, MAX_OFF_MM)
    covered, across = _needle(rng, U_MM, V_MM - off_mm, tip_mm)
    blur_mm, body = _log_uniform(rng, BLUR_MM), _brightness(rng, U_MM, across)
    tint = _brightness(rng, U_MM, across) if rng.random() < TINT_SHARE else 1.0
    shadow, ground = _shadow(rng, U_MM, V_MM - off_mm, tip_mm), _ground(rng)
    above = _log_uniform(rng, GREY) * _through_lens(covered * body, blur_mm) + shadow
    color = rng.choice(COLORS) * _log_uniform(rng, GREY) * _through_lens(covered * tint, blur_mm)
    layers = above + rng.uniform(0, LEFT_SHARE) * ground, above + ground, color
    seen, noise_grey = _by_camera(rng, np.stack(layers, axis=-1))
    is_inside = (np.arange(STATIONS) >= rng.integers(-STATIONS, BEHIND - 8)).astype(float)
    values = np.concatenate([seen.reshape(CHANNELS * ACROSS, STATIONS) * is_inside, is_inside[None]])
    return values.reshape(VALUES).astype(np.float16), float(tip_mm), noise_grey


def _by_camera(rng: Generator, layers: Floats) -> tuple[Floats, float]:
    """Return what a strip of noisy pixels shows of layers, (CHANNELS, ACROSS, STATIONS), and the noise."""
    px_mm, noise_grey = 1 / _log_uniform(rng, PX_PER_MM), _log_uniform(rng, NOISE_GREY)
    steps_mm, phases = (STATION_PX * px_mm, px_mm), rng.random(2)
    spans_mm = U_MM[-1] - U_MM[0], V_MM[-1, 0] - V_MM[0, 0]
    counts = [int(span / step) + 3 for span, step in zip(spans_mm, steps_mm, strict=True)]
    at = [np.arange(count) + phase - 1 for count, phase in zip(counts, phases, strict=True)]
    fine_mm = STEP_MM / FINE, LANE_MM / FINE
    x, y = (each * step / fine for each, step, fine in zip(at, steps_mm, fine_mm, strict=True))
    pixels = _sampled(layers, x, y)
    noise = rng.normal(0, noise_grey, (*pixels.shape[:2], 2))
    pixels += noise[..., [0, 0, 1]]
    centers_mm = np.arange(STATIONS) * STEP_MM, (np.arange(ACROSS) + 0.5) * LANE_MM - LANE_MM / FINE / 2
    x, y = (mm / step - phase + 1 for mm, step, phase in zip(centers_mm, steps_mm, phases, strict=True))
    return np.moveaxis(_sampled(pixels, x, y), -1, 0), noise_grey


def _sampled(layers: Floats, x: Floats, y: Floats) -> Floats:
    """Return layers at columns and rows that may lie between theirs."""
    columns, rows = (np.asarray(grid, np.float32) for grid in np.meshgrid(x, y))
    found = cv2.remap(
        layers.astype(np.float32), columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(found, float)


def _log_uniform(rng: Generator, limits: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(limits))))


def _needle(rng: Generator, u_mm: Floats, v_mm: Floats, tip_mm: float) -> tuple[Floats, Floats]:
    """Return what a needle covers, 0 to 1, and how far across it each place is, -1 to 1."""
    half_mm = _log_uniform(rng, WIDTH_MM) / 2
    point = rng.choice(["blunt", "cone", "cone", "bevel", "round"])
    rest_mm = np.maximum(tip_mm - u_mm, 0)[None]
    if point == "cone":
        width_mm = half_mm * np.clip(rest_mm / _log_uniform(rng, TAPER_MM), 0, 1)
    elif point == "round":
        width_mm = half_mm * np.sqrt(np.clip(1 - np.square(1 - np.minimum(rest_mm / half_mm, 1)), 0, 1))
    else:
        width_mm = half_mm * (rest_mm > 0)
    upper_mm = width_mm
    if point == "bevel":
        side = np.clip(2 * rest_mm / _log_uniform(rng, BEVEL_MM) - 1, -1, 1)
        upper_mm = np.minimum(width_mm, half_mm * side)
    px_mm = LANE_MM / FINE
    covered = np.clip((upper_mm - v_mm) / px_mm + 0.5, 0, 1) * np.clip((width_mm + v_mm) / px_mm + 0.5, 0, 1)
    covered = covered * np.clip(2 * width_mm / px_mm, 0, 1) * (rest_mm > 0)
    return covered, v_mm / np.maximum(width_mm, px_mm)


def _brightness(rng: Generator, u_mm: Floats, across: Floats) -> Floats:
    """Return how bright metal is over its ground: a body, a highlight, and rims, each changing along it."""
    layers = (
        rng.normal(0, 1),
        rng.normal(0, 1.5) * (rng.random() < 0.6),
        rng.normal(0, 1) * (rng.random() < 0.5),
    )
    at, width = rng.uniform(-0.6, 0.6), rng.uniform(0.15, 0.5)
    shapes = (
        np.ones_like(across),
        np.exp(-np.square((across - at) / width) / 2),
        np.square(np.clip(across, -1, 1)),
    )
    total = sum(layer * shape * _along(rng, u_mm) for layer, shape in zip(layers, shapes, strict=True))
    return total / (np.abs(layers).sum() + 1e-3)


def _along(rng: Generator, u_mm: Floats) -> Floats:
    waves, phase = rng.uniform(0.02, 0.3), rng.uniform(0, 2 * np.pi)
    return 1 + rng.uniform(0, 0.7) * np.sin(2 * np.pi * waves * u_mm + phase)[None]


def _through_lens(picture: Floats, blur_mm: float) -> Floats:
    sigmas = blur_mm / STEP_MM * FINE, blur_mm / LANE_MM * FINE
    return cv2.GaussianBlur(picture, (0, 0), sigmas[0], sigmaY=sigmas[1])


def _shadow(rng: Generator, u_mm: Floats, v_mm: Floats, tip_mm: float) -> Floats | float:
    """Return a soft shadow beside or beyond the needle, mostly none."""
    if rng.random() < 0.6:
        return 0.0
    off_mm, sd_mm = rng.normal(0, 0.25), rng.uniform(0.1, 0.4)
    end_mm = tip_mm + rng.uniform(-1, 3)
    across = np.exp(-np.square((v_mm - off_mm) / sd_mm) / 2)
    return -rng.uniform(1, 25) * across / (1 + np.exp((u_mm - end_mm)[None] / rng.uniform(0.05, 0.5)))


def _ground(rng: Generator) -> Floats:
    """Return what the ground itself looks like: grain, and vessels across or along the shaft."""
    grain = cv2.resize(rng.normal(0, 1, (ACROSS, STATIONS)), (len(U_MM), len(V_MM)))
    ground = cv2.GaussianBlur(grain, (0, 0), rng.uniform(3, 15)) * rng.uniform(0, 25)
    for _ in range(rng.integers(0, 3)):
        turn, at_mm = rng.uniform(0, np.pi), rng.uniform(U_MM[0], U_MM[-1])
        off_mm = (U_MM[None] - at_mm) * np.sin(turn) - V_MM * np.cos(turn)
        ground = ground - rng.uniform(5, 90) * np.exp(-np.square(off_mm / rng.uniform(0.05, 0.3)) / 2)
    return np.asarray(ground, float)
