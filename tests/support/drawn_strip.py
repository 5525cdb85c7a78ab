"""Drawn needles for tests: rectified strips with a shaft along the middle and a camera's noise, and images."""

import cv2
import numpy as np

from haptigraph.perception.needle.rectify import (
    STATION_PX,
    EyeGeometry,
    Line,
    RectifiedStrip,
    rectify,
    stations,
)
from haptigraph.perception.needle.shaft_line import fit_line

HALF_PX, NOISE_GREY, END_PX = 16, 2.0, 140.0
LANES = np.arange(-HALF_PX, HALF_PX + 1)[:, None]
U_PX = np.arange(-40, 300, STATION_PX, dtype=np.float32)
SHADOW = np.exp(-((LANES / 9) ** 2))  # edges as soft as those of a lamp's shadow
GROUND, METAL, RIM = 150, 70, 110


def strip(excess, u_px=U_PX):
    noise = np.random.default_rng(7).normal(0, NOISE_GREY, excess.shape)
    planes = np.stack([(excess + noise).astype(np.float32)] * 2)
    first = int(u_px.searchsorted(8))
    outside, inside = slice(0, max(first - 14, 0)), slice(first, len(u_px))
    return RectifiedStrip(u_px, HALF_PX, planes, np.ones(len(u_px), bool), outside, inside, NOISE_GREY)


def needle(half_width_px, until_px=END_PX, grey=-40.0):
    across = np.clip(half_width_px + 0.5 - abs(LANES), 0, 1)
    return grey * across * (until_px >= U_PX)


def blurred(drawn, blur_px, step_px=1.0):
    """A drawn strip through a lens, with so many px between stations."""
    return cv2.GaussianBlur(drawn.astype(np.float32), (0, 0), blur_px / step_px, sigmaY=blur_px)


def fitted_blur_px(shaft):
    """Blur across the edges of a shaft on `U_PX` that reaches to `END_PX`, as the line's fit measures it."""
    drawn = strip(shaft)
    return fit_line(drawn, END_PX, drawn.half_px).blur_px


def strip_of(
    eye: EyeGeometry, image: np.ndarray, background: np.ndarray, line: Line, **settings: float
) -> RectifiedStrip:
    """All of an image along a line."""
    (whole,) = rectify(eye, image, background, line, stations(eye, line), **settings)
    return whole


def draw_rim(image: np.ndarray, eye: EyeGeometry) -> np.ndarray:
    """Draw the globe's rim, in place; return the image."""
    center_px = tuple(round(value) for value in eye.center_px)
    return cv2.circle(image, center_px, round(eye.inner_px), (RIM,) * 3, 2, cv2.LINE_AA)


def draw_needle(
    eye: EyeGeometry, line: Line, depth_px: float, *, metal: int = METAL, noise: float = 1.0
) -> np.ndarray:
    """A plain needle of 0.5 mm on plain ground, sixteen times too large and then reduced; no wall."""
    finer = 4
    image = np.full((eye.height_px * finer, eye.width_px * finer), GROUND, np.uint8)
    start, end = (line.at_px(eye.trocar_px, along) for along in (-300.0, depth_px))
    ends = [tuple(round(16 * (finer * value + (finer - 1) / 2)) for value in place) for place in (start, end)]
    half_px = 0.25 * eye.px_per_mm * finer
    nx, ny = (16 * half_px * value for value in line.normal)
    corners = [
        (x + s * nx, y + s * ny) for (x, y), s in ((ends[0], -1), (ends[1], -1), (ends[1], 1), (ends[0], 1))
    ]
    cv2.fillConvexPoly(image, np.rint(corners).astype(np.int32), metal, lineType=cv2.LINE_AA, shift=4)
    small = cv2.resize(image, (eye.width_px, eye.height_px), interpolation=cv2.INTER_AREA).astype(np.float32)
    soft = cv2.GaussianBlur(small, (0, 0), 0.7)
    return np.clip(soft + np.random.default_rng(1).normal(0, noise, soft.shape), 0, 255).astype(np.uint8)
