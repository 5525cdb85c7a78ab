"""The intrinsics of a camera: where an ideal camera without distortion would have imaged a point [px].

The distortion is the model of Brown and Conrady with the coefficients of OpenCV (D. C. Brown, "Decentering
distortion of lenses", Photogrammetric Engineering 32, 1966).
"""

import math

from msgspec import Struct

from haptigraph.geometry import Vec

__all__ = ["Lens"]

MAX_ITERATIONS = 100
PRECISION = 1e-9  # of a point at unit distance; 1e-6 px of a camera with a focal length of 1000 px
STEPS = 200


class Lens(Struct, frozen=True, forbid_unknown_fields=True):
    """The intrinsics of one camera. The ideal camera has square pixels and the same principal point."""

    focal_px: Vec
    """Focal length by the width and by the height of a pixel."""
    principal_px: Vec
    distortion: tuple[float, float, float, float, float]
    """k1, k2, p1, p2, k3, as OpenCV orders them."""
    sd_px: float | None = None
    """Standard deviation of a corrected point at the worst place of the image, as far as a registration does
    not compensate for it; None: nobody measured it."""

    @property
    def ideal_focal_px(self) -> float:
        """Focal length of the ideal camera."""
        return math.sqrt(self.focal_px[0] * self.focal_px[1])

    def distorted(self, ideal_px: Vec) -> Vec:
        """Return the position in the camera's image of a point in that of the ideal camera."""
        focal = self.ideal_focal_px
        x, y = self._bent(
            (ideal_px[0] - self.principal_px[0]) / focal, (ideal_px[1] - self.principal_px[1]) / focal
        )
        return self.principal_px[0] + self.focal_px[0] * x, self.principal_px[1] + self.focal_px[1] * y

    def undistorted(self, at_px: Vec) -> Vec:
        """Return the position in the ideal camera's image of a point in the camera's image."""
        seen_x = (at_px[0] - self.principal_px[0]) / self.focal_px[0]
        seen_y = (at_px[1] - self.principal_px[1]) / self.focal_px[1]
        x, y = seen_x, seen_y
        # Newton's method would need the derivatives, and few points are mapped.
        for _ in range(MAX_ITERATIONS):
            bent_x, bent_y = self._bent(x, y)
            x, y = x + seen_x - bent_x, y + seen_y - bent_y
            if abs(seen_x - bent_x) + abs(seen_y - bent_y) < PRECISION:
                break
        focal = self.ideal_focal_px
        return self.principal_px[0] + focal * x, self.principal_px[1] + focal * y

    def is_invertible(self, width_px: int, height_px: int) -> bool:
        """Return whether the distortion maps no two points of an image of this size to the same place."""
        corners = (
            ((x - self.principal_px[0]) / self.focal_px[0], (y - self.principal_px[1]) / self.focal_px[1])
            for x in (0, width_px - 1)
            for y in (0, height_px - 1)
        )
        farthest = max(math.hypot(*corner) for corner in corners)
        k1, k2, _, _, k3 = self.distortion
        for step in range(1, STEPS):
            squared = (2 * farthest * step / STEPS) ** 2
            if 1 + squared * (3 * k1 + squared * (5 * k2 + squared * 7 * k3)) <= 0:
                return False
            if math.sqrt(squared) * (1 + squared * (k1 + squared * (k2 + squared * k3))) > farthest:
                return True
        return False

    def _bent(self, x: float, y: float) -> Vec:
        """Distort a point at unit distance from the camera."""
        k1, k2, p1, p2, k3 = self.distortion
        squared = x * x + y * y
        radial = 1 + squared * (k1 + squared * (k2 + squared * k3))
        return (
            x * radial + 2 * p1 * x * y + p2 * (squared + 2 * x * x),
            y * radial + p1 * (squared + 2 * y * y) + 2 * p2 * x * y,
        )
