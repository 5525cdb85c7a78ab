"""Strips for tests: drawn, with a shaft along the middle, lanes across it and a camera's noise, or of an image."""

import cv2
import numpy as np

from haptigraph.perception.needle.rectify import STATION_PX, Line, RectifiedStrip, Site, rectify, stations
from haptigraph.perception.needle.shaft_line import fit_line

HALF_PX, NOISE_GREY, END_PX = 16, 2.0, 140.0
LANES = np.arange(-HALF_PX, HALF_PX + 1)[:, None]
U_PX = np.arange(-40, 300, STATION_PX, dtype=np.float32)
SHADOW = np.exp(-((LANES / 9) ** 2))  # edges as soft as those of a lamp's shadow


def strip(excess, u_px=U_PX):
    noise = np.random.default_rng(7).normal(0, NOISE_GREY, excess.shape)
    seen = (excess + noise).astype(np.float32)
    first = int(u_px.searchsorted(8))
    before, inside = slice(0, max(first - 14, 0)), slice(first, len(u_px))
    return RectifiedStrip(u_px, HALF_PX, seen, seen, np.ones(len(u_px), bool), before, inside, NOISE_GREY)


def needle(half_width_px, until_px=END_PX, grey=-40.0):
    across = np.clip(half_width_px + 0.5 - abs(LANES), 0, 1)
    return grey * across * (until_px >= U_PX)


def blurred(drawn, blur_px, step_px=1.0):
    """A drawn strip through a lens; its stations lie so far apart."""
    return cv2.GaussianBlur(drawn.astype(np.float32), (0, 0), blur_px / step_px, sigmaY=blur_px)


def seen_blur_px(shaft):
    """Blur across the edges of a shaft on `U_PX` that reaches to `END_PX`, as the line's fit tells it."""
    seen = strip(shaft)
    return fit_line(seen, END_PX, seen.half_px).blur_px


def strip_of(site: Site, image: np.ndarray, empty: np.ndarray, line: Line, **seen: float) -> RectifiedStrip:
    """All of an image along a line."""
    (whole,) = rectify(site, image, empty, line, stations(site, line), **seen)
    return whole
