"""Map between a tilted view of a plane and its frontal view [px]: a pinhole camera with square pixels."""

import math

import numpy as np
from msgspec import Struct

from haptigraph.geometry import Vec
from haptigraph.projection import Homography

__all__ = ["CameraTilt"]


class CameraTilt(Struct, frozen=True):
    """A plane rotated about one of its points, so that it no longer faces the camera.

    The frontal view is the view before the rotation: same camera, same point, plane parallel to the sensor.
    """

    about_px: Vec
    """Centre of rotation, the same point in both views."""
    tilt_rad: Vec
    """(right, down) components of the angle; the plane recedes from the camera towards that side."""
    focal_px: float
    """Distance to the camera in pixels of the plane; infinite: parallel rays."""
    principal_px: Vec
    """Principal point: where the optical axis meets the image."""

    @property
    def angle_deg(self) -> float:
        """Angle between the plane and the sensor."""
        return math.degrees(math.hypot(*self.tilt_rad))

    @property
    def image_from_frontal(self) -> Homography:
        """Homography from the frontal view to the image."""
        tilt, angle = np.array(self.tilt_rad), math.hypot(*self.tilt_rad)
        about, principal = np.array(self.about_px), np.array(self.principal_px)
        # A point X away from `about` in the frontal view is imaged at
        # principal + (about - principal + flat X) / (1 + depth . X).
        depth = tilt * np.sinc(angle / math.pi) / self.focal_px
        flat = np.eye(2) - np.outer(tilt, tilt) * np.sinc(angle / 2 / math.pi) ** 2 / 2
        rotation, shift = np.eye(3), np.eye(3)
        rotation[:2, :2] = flat + np.outer(principal, depth)
        rotation[:2, 2] = about
        rotation[2, :2] = depth
        shift[:2, 2] = -about
        matrix = rotation @ shift
        return Homography(tuple(tuple(row) for row in (matrix / matrix[2, 2]).tolist()))

    @property
    def frontal_from_image(self) -> Homography:
        """Homography from the image to the frontal view."""
        return self.image_from_frontal.inverse

    @property
    def foot_px(self) -> Vec:
        """Foot of the perpendicular from the camera to the plane, in the frontal view.

        Parallel planes nearer to the camera appear enlarged about this point.
        """
        off = self.about_px[0] - self.principal_px[0], self.about_px[1] - self.principal_px[1]
        angle = math.hypot(*self.tilt_rad)
        if angle == 0:
            return self.principal_px
        x, y = self.tilt_rad[0] / angle, self.tilt_rad[1] / angle
        up = (off[0] * x + off[1] * y) * math.cos(angle) + self.focal_px * math.sin(angle)
        across = off[1] * x - off[0] * y
        return self.about_px[0] - up * x + across * y, self.about_px[1] - up * y - across * x
