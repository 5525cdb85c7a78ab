"""How a plane looks to a camera that does not look straight at it: a pinhole camera with square pixels.

Turns an angle and a focal length into maps between pictures [px]. Knows neither images nor eyes.
"""

import math

import numpy as np
from msgspec import Struct

from haptigraph.geometry import Homography, Vec

__all__ = ["Slant"]


class Slant(Struct, frozen=True):
    """A plane, turned about one of its places away from facing the camera.

    The straight picture is the one before the turn: same camera, same place, plane parallel to the sensor.
    """

    about_px: Vec
    """The place, the same in both pictures."""
    tilt_rad: Vec
    """(right, down) part of the angle: what lies on that side goes away from the camera."""
    focal_px: float
    """Distance to the camera in pixels of the plane; infinite: parallel rays."""
    middle_px: Vec
    """Where the camera's axis meets the image."""

    @property
    def angle_deg(self) -> float:
        """Between the plane and one that faces the camera."""
        return math.degrees(math.hypot(*self.tilt_rad))

    @property
    def image_from_frontal(self) -> Homography:
        """From the straight picture to the one the camera takes."""
        tilt, angle = np.array(self.tilt_rad), math.hypot(*self.tilt_rad)
        about, middle = np.array(self.about_px), np.array(self.middle_px)
        # The place X away from `about` in the straight picture is seen at
        # middle + (about - middle + flat X) / (1 + depth . X).
        depth = tilt * np.sinc(angle / math.pi) / self.focal_px
        flat = np.eye(2) - np.outer(tilt, tilt) * np.sinc(angle / 2 / math.pi) ** 2 / 2
        turned, back = np.eye(3), np.eye(3)
        turned[:2, :2] = flat + np.outer(middle, depth)
        turned[:2, 2] = about
        turned[2, :2] = depth
        back[:2, 2] = -about
        matrix = turned @ back
        return Homography(tuple(tuple(row) for row in (matrix / matrix[2, 2]).tolist()))

    @property
    def frontal_from_image(self) -> Homography:
        """The way back."""
        return self.image_from_frontal.inverse

    @property
    def foot_px(self) -> Vec:
        """The place in the straight picture right under the camera.

        What stands before the plane is seen larger from there.
        """
        off = self.about_px[0] - self.middle_px[0], self.about_px[1] - self.middle_px[1]
        angle = math.hypot(*self.tilt_rad)
        if angle == 0:
            return self.middle_px
        x, y = self.tilt_rad[0] / angle, self.tilt_rad[1] / angle
        up = (off[0] * x + off[1] * y) * math.cos(angle) + self.focal_px * math.sin(angle)
        across = off[1] * x - off[0] * y
        return self.about_px[0] - up * x + across * y, self.about_px[1] - up * y - across * x
