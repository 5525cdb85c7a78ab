"""Scenes drawn by lot: a number -> a scene, for training, or to test what was trained on others."""

import numpy as np
from numpy.random import Generator

from rendering.scene import Bowl, Camera, Color, Instrument, Light, Needle, Scene

__all__ = ["LEARNED", "UNSEEN", "drawn_scene"]

LEARNED = range(1, 111)
"""Numbers of the scenes that the tip network learns from."""
UNSEEN = range(111, 156)
"""Numbers of the scenes that show whether its certainty is true: it does not learn from them."""

POINTS, POINT_SHARES = ("cone", "bevel", "round", "blunt"), (0.4, 0.25, 0.2, 0.15)
SOME = 0.35  # of the scenes have beads, a second instrument, another bottom, a wide pixel filter
GOLDEN, BLACK = 0.08, 0.08  # shares of the needles
LIGHTS_MM = 8, 20, 40, 80  # sizes


def drawn_scene(number: int) -> Scene:
    """Return the scene that belongs to a number."""
    rng = np.random.default_rng([26, number])
    return Scene(
        description=f"Drawn by lot: {number}.",
        seed=number,
        trocar="first" if rng.random() < 0.5 else "second",
        target_deg=float(rng.uniform(-30, 30)),
        start_deg=float(rng.uniform(-9, 9)),
        camera=_camera(rng),
        bowl=_bowl(rng),
        needle=_needle(rng),
        lights=tuple(_light(rng, strength) for strength in (1.0, *rng.uniform(0.3, 0.8, rng.integers(0, 3)))),
        second_instrument=_second_instrument(rng) if rng.random() < SOME else None,
        beads=int(rng.integers(1, 7)) if rng.random() < SOME else 0,
        ambient=float(rng.uniform(0.2, 0.65)),
    )


def _camera(rng: Generator) -> Camera:
    return Camera(
        px_per_mm=float(rng.uniform(12, 22)),
        globe_mm=(float(rng.uniform(-1, 1)), float(rng.uniform(-1.5, 0.5))),
        filter_px=float(rng.uniform(1.5, 4)) if rng.random() < SOME else 1.5,
        exposure_stops=float(rng.normal(0, 0.35)),
    )


def _bowl(rng: Generator) -> Bowl:
    red = rng.uniform(0.15, 0.75)
    green, blue = red * rng.uniform(0.4, 1), red * rng.uniform(0.3, 1.05)
    return Bowl(
        color=_color(red, green, blue),
        rim_color=_color(*np.multiply((red, green, blue), rng.uniform(1, 1.6, 3))),
        lower_color=_color(*np.multiply((red, green, blue), rng.uniform(0.5, 1.1, 3)))
        if rng.random() < SOME
        else None,
        mottle=float(rng.uniform(0.02, 0.14)),
        vessels=bool(rng.random() < 0.5),
    )


def _needle(rng: Generator) -> Needle:
    point = rng.choice(POINTS, p=POINT_SHARES)
    grey, kind = rng.uniform(0.35, 0.8), rng.random()
    color, is_metal = _color(*grey * rng.uniform(0.92, 1.08, 3)), True
    if kind < GOLDEN:
        color = _color(*np.multiply((1, 0.75, 0.4), grey))
    elif kind < GOLDEN + BLACK:
        color, is_metal = _color(*rng.uniform(0.01, 0.12, 3)), False
    return Needle(
        point=str(point),
        width_mm=float(rng.uniform(0.25, 0.85)),
        taper_mm=float(rng.uniform(1, 7)) if point == "cone" else None,
        roll_deg=float(rng.uniform(-180, 180)) if point == "bevel" else None,
        color=color,
        roughness=float(rng.uniform(0.15, 0.55)),
        is_metal=is_metal,
    )


def _second_instrument(rng: Generator) -> Instrument:
    return Instrument(
        width_mm=float(rng.uniform(0.4, 0.9)),
        aim_deg=float(rng.uniform(-25, 25)),
        depth_mm=float(rng.uniform(6, 13)),
        roughness=float(rng.uniform(0.2, 0.5)),
    )


def _light(rng: Generator, strength: float) -> Light:
    towards = float(rng.uniform(-0.9, 0.9)), -1.0, float(rng.uniform(0.1, 1.2))
    return Light(towards=towards, size_mm=float(rng.choice(LIGHTS_MM)), strength=float(strength))


def _color(*linear: float) -> Color:
    red, green, blue = (float(np.clip(each, 0, 1)) for each in linear)
    return red, green, blue
