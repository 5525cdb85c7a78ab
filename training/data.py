"""Training data: random simulated B-scans at the network's size, with the share of every class in each pixel.

B-scans of half the size are the mean of two by two pixels, and so are their labels: a pixel on a border
belongs to both sides in part, which is what tells the network where between two pixels the border lies.
"""

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.sim.oct.bscan import CLASSES
from haptigraph.sim.oct.scenes import random_scene

__all__ = ["SIDE_PX", "SIMULATED_PX", "Example", "batches", "draw", "simulate"]

SIDE_PX = 256
"""Width and height of what the network sees."""
SIMULATED_PX = 512


class Example(NamedTuple):
    """Simulated B-scans at full size and what they show."""

    image: NDArray[np.uint8]
    """(512, 512)."""
    shown: NDArray[np.uint8]
    """(512, 512) indices into `CLASSES`."""


def simulate(number: int, seed: int) -> Example:
    """Return one random B-scan with its classes."""
    scene = random_scene(number, seed, size_px=(SIMULATED_PX, SIMULATED_PX))
    camera = scene.camera()
    scan = scene.take(camera)
    return Example(scan.image, camera.classes(scan.truth))


def draw(example: Example, rng: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return an example as the network sees it, changed at random.

    Returns:
        The image, (1, side, side) in [0, 1], and the share of each class, (classes, side, side).
    """
    image, shown = example
    if rng.random() < 0.5:
        image, shown = image[:, ::-1], shown[:, ::-1]
    top, left, height, width = _part(rng)
    image = np.ascontiguousarray(image[top : top + height, left : left + width])
    shown = np.ascontiguousarray(shown[top : top + height, left : left + width])
    grey = cv2.resize(image, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA).astype(np.float32)
    is_class = ((shown == number).astype(np.uint8) * 255 for number in range(len(CLASSES)))
    shares = np.stack([cv2.resize(one, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA) for one in is_class])
    return _relit(grey, rng)[None], shares.astype(np.float32) / 255


def _part(rng: np.random.Generator) -> tuple[int, int, int, int]:
    """Return top, left, height, width of the part that is seen: all of it, or a smaller one, magnified."""
    if rng.random() < 0.4:
        return 0, 0, SIMULATED_PX, SIMULATED_PX
    height, width = (int(SIMULATED_PX * rng.uniform(0.4, 1.0)) for _ in range(2))
    return (
        int(rng.integers(0, SIMULATED_PX - height + 1)),
        int(rng.integers(0, SIMULATED_PX - width + 1)),
        height,
        width,
    )


def _relit(grey: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Change brightness, contrast and sharpness as devices and their software do."""
    share = np.clip(grey / 255, 0, 1) ** np.float32(np.exp(rng.normal(0, 0.2)))
    share = (share - 0.5) * np.float32(np.exp(rng.normal(0, 0.15))) + 0.5 + np.float32(rng.normal(0, 0.05))
    if rng.random() < 0.3:
        share = cv2.GaussianBlur(share, (0, 0), rng.uniform(0.4, 1.0))
    if rng.random() < 0.3:
        share = share + np.float32(rng.uniform(0.0, 0.04)) * rng.standard_normal(share.shape, np.float32)
    return np.clip(share, 0, 1).astype(np.float32)


def batches(
    examples: list[Example], size: int, count: int, rng: np.random.Generator
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Yield batches; every example comes once before any comes twice."""
    waiting: list[int] = []
    for _ in range(count):
        if len(waiting) < size:
            waiting += rng.permutation(len(examples)).tolist()
        drawn = [draw(examples[waiting.pop(0)], rng) for _ in range(size)]
        yield np.stack([image for image, _ in drawn]), np.stack([shares for _, shares in drawn])
