"""Views of a ChArUco board as a lens images them, without pictures."""

import cv2
import numpy as np

from haptigraph.analysis.calibrating.board import Board, View
from haptigraph.lens import Lens

BOARD = Board(24, 17)
SIZE_PX = 1280, 720
LENS = Lens((900.0, 900.9), (648.0, 352.0), (-0.1, 0.02, 5e-4, -8e-4, 0.0))


def view_of(lens: Lens, aim_px, tilt_deg: tuple[float, float], square_px: float, rng, noise_px=0.1) -> View:
    """The board with its middle near a place of the image, tilted about x and y."""
    squares = np.stack(np.meshgrid(np.arange(1, 24), np.arange(1, 17)), axis=-1).reshape(-1, 2).astype(float)
    focal = lens.ideal_focal_px
    rotation = cv2.Rodrigues(np.array([*np.radians(tilt_deg), rng.normal(0, 0.2)]))[0]
    ray = np.array([*((np.array(aim_px) - lens.principal_px) / focal), 1.0]) * focal / square_px
    at = np.pad(squares - (12, 8.5), ((0, 0), (0, 1))) @ rotation.T + ray
    ideal = at[:, :2] / at[:, 2:] * focal + lens.principal_px
    points = np.array([lens.distorted((x, y)) for x, y in ideal.tolist()])
    inside = ((points >= 0) & (points < np.array(SIZE_PX) - 1)).all(axis=1)
    noisy = points[inside] + rng.normal(0, noise_px, (inside.sum(), 2))
    return View(np.flatnonzero(inside), noisy, squares[inside])


def good_views(rng, count=16, lens=LENS, noise_px=0.1) -> list[View]:
    """Views that determine the lens."""
    aims = [(x, y) for x in (150, 450, 830, 1130) for y in (110, 260, 460, 610)]
    tilts = [
        (rng.uniform(15, 35) * rng.choice((-1, 1)), rng.uniform(15, 35) * rng.choice((-1, 1)))
        for _ in range(count)
    ]
    return [
        view_of(lens, aims[number % len(aims)], tilts[number], rng.uniform(40, 60), rng, noise_px)
        for number in range(count)
    ]
