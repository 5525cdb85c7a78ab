"""Training data: random simulated B-scans at the network's size, with the share of every class in each pixel.

B-scans are downsampled by averaging two by two pixels, and so are their labels: a pixel on a border belongs
to both sides in part, from which the network learns the border's sub-pixel position.
"""

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.sim.oct.bscan import CLASSES, BscanCamera, BscanTruth
from haptigraph.sim.oct.diseased import random_detailed_scene
from haptigraph.sim.oct.scenes import PLACES, random_scene

__all__ = ["SIDE_PX", "SIMULATED_PX", "Example", "batches", "draw", "labels_of", "simulate"]

SIDE_PX = 256
"""Width and height of the network's input."""
SIMULATED_PX = 512
PLAIN, WITH_NEEDLE = 3, 2
"""Of ten scenes, the number with a plain retina; of those with detailed tissue, the number with a needle."""
HEALTHY = 4, 8, 9
"""Scenes of ten with detailed tissue and without lesions."""
PADDING_CHANCE, MAX_PADDING = 0.08, 0.3


class Example(NamedTuple):
    """A simulated B-scan at full size with its labels."""

    image: NDArray[np.uint8]
    """(512, 512)."""
    labels: NDArray[np.uint8]
    """(512, 512) indices into `CLASSES`."""


def simulate(number: int, seed: int) -> Example:
    """Simulate one random B-scan with its labels.

    Of ten, three show a plain retina, most with a needle; seven show detailed tissue, four of them diseased
    and two with a needle.
    """
    cycle, kind = divmod(number, 10)
    size_px = SIMULATED_PX, SIMULATED_PX
    if kind < PLAIN:
        scene = random_scene(cycle * PLAIN + kind, seed, size_px=size_px)
    else:
        place = PLACES[cycle % 3] if kind < PLAIN + WITH_NEEDLE else "none"
        diseased = kind not in HEALTHY
        scene = random_detailed_scene(number, seed, diseased=diseased, place=place, size_px=size_px)
    camera = scene.camera()
    scan = scene.take(camera)
    return Example(scan.image, labels_of(camera, scan.truth))


def labels_of(camera: BscanCamera, truth: BscanTruth) -> NDArray[np.uint8]:
    """Return the class of every pixel, (h, w) indices into `CLASSES`.

    Everything below the RPE is one class down to the image's border, so that in every column without shadow
    the classes follow each other in one order.
    """
    labels = camera.classes(truth)
    is_below = np.arange(len(labels))[:, None] >= truth.rpe_px
    labels[is_below & (labels == CLASSES.index("vitreous"))] = CLASSES.index("rpe_choroid")
    return labels


def draw(example: Example, rng: np.random.Generator) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return a randomly augmented example at the network's size.

    Returns:
        The image, (1, side, side) in [0, 1], and the share of each class, (classes, side, side).
    """
    image, labels = example
    if rng.random() < PADDING_CHANCE:
        image, labels = _padded(image, labels, rng)
    if rng.random() < 0.5:
        image, labels = image[:, ::-1], labels[:, ::-1]
    top, left, height, width = _random_crop(rng)
    image = np.ascontiguousarray(image[top : top + height, left : left + width])
    labels = np.ascontiguousarray(labels[top : top + height, left : left + width])
    grey = cv2.resize(image, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA).astype(np.float32)
    is_class = ((labels == number).astype(np.uint8) * 255 for number in range(len(CLASSES)))
    shares = np.stack([cv2.resize(one, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA) for one in is_class])
    return _random_contrast(grey, rng)[None], shares.astype(np.float32) / 255


def _padded(
    image: NDArray[np.uint8], labels: NDArray[np.uint8], rng: np.random.Generator
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Blank columns at the border, as an eye tracker does where it has lost the eye."""
    image, labels = image.copy(), labels.copy()
    columns = int(SIMULATED_PX * rng.uniform(0.02, MAX_PADDING))
    image[:, :columns] = 255 if rng.random() < 0.2 else 0
    labels[:, :columns] = CLASSES.index("shadow")
    return image, labels


def _random_crop(rng: np.random.Generator) -> tuple[int, int, int, int]:
    """Return top, left, height, width of a random crop, which may be the whole image."""
    if rng.random() < 0.4:
        return 0, 0, SIMULATED_PX, SIMULATED_PX
    height, width = (int(SIMULATED_PX * rng.uniform(0.4, 1.0)) for _ in range(2))
    return (
        int(rng.integers(0, SIMULATED_PX - height + 1)),
        int(rng.integers(0, SIMULATED_PX - width + 1)),
        height,
        width,
    )


def _random_contrast(grey: NDArray[np.float32], rng: np.random.Generator) -> NDArray[np.float32]:
    """Vary brightness, contrast, sharpness and noise as between devices and their software."""
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
    """Yield batches; every example is used once before any is repeated."""
    remaining: list[int] = []
    for _ in range(count):
        if len(remaining) < size:
            remaining += rng.permutation(len(examples)).tolist()
        drawn = [draw(examples[remaining.pop(0)], rng) for _ in range(size)]
        yield np.stack([image for image, _ in drawn]), np.stack([shares for _, shares in drawn])
