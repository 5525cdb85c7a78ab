"""The simulated camera's sensor: read and shot noise."""

import cv2
import numpy as np

from haptigraph.imaging import FloatImage
from haptigraph.messages import Image
from haptigraph.sim.eye.optics import CameraSettings

__all__ = ["Sensor"]

NOISE_MARGIN_PX = 256
NOISE_STRIP_PX = 36


class Sensor:
    """Add noise to images; the same image number always gives the same noise.

    Args:
        settings: Image size and noise.
        seed: Seed of the noise.
    """

    def __init__(self, settings: CameraSettings, seed: int) -> None:
        self._seed = seed
        rng = np.random.default_rng((seed, 3))
        tile = settings.height_px + NOISE_MARGIN_PX, settings.width_px + NOISE_MARGIN_PX
        self._noise = rng.standard_normal(tile, np.float32)
        grey = np.arange(256, dtype=np.float32)
        self._sd_of = np.sqrt(settings.read_noise_grey**2 + settings.shot_noise_grey**2 * grey / 255)

    def noise_sd(self, image: Image) -> FloatImage:
        """Return the standard deviation of the noise for an image, (h, w) grey levels."""
        return np.asarray(cv2.LUT(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), self._sd_of), np.float32)

    def with_noise(self, image: Image, sd_grey: FloatImage, number: int) -> Image:
        """Add noise in place, the same in all three colours (JPEG preserves little more)."""
        rng = np.random.default_rng((self._seed, 4, number))
        top, left = rng.integers(0, NOISE_MARGIN_PX, 2)
        noise = self._noise[top : top + image.shape[0], left : left + image.shape[1]]
        # Strips fit in the processor's cache. Adding and subtracting separately, each saturating in 8 bits,
        # is four times as fast as one pass in float.
        for start in range(0, image.shape[0], NOISE_STRIP_PX):
            strip = slice(start, start + NOISE_STRIP_PX)
            for change, scale in ((cv2.add, 1), (cv2.subtract, -1)):
                grey = cv2.multiply(sd_grey[strip], noise[strip], scale=scale, dtype=cv2.CV_8U)
                change(image[strip], cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dst=image[strip])
        return image
