"""Where the design of a set-up has the anatomy in the image: a prior for the search [px]."""

from collections.abc import Sequence
from itertools import combinations

from msgspec import Struct

from haptigraph.geometry import Vec

__all__ = ["Expected"]

NEAR_SD = 4.0  # what is expected is searched within so many standard deviations
SLACK_PX = 4.0  # as much does the search itself add
WALL_SLACK = 0.02  # of the ratio of radii: the edges of a printed wall are rounded


class Expected(Struct, frozen=True):
    """The anatomy as designed, with standard deviations; angles from the top, positive to the right."""

    center_px: Vec
    """Of the globe's section."""
    center_sd_px: Vec
    radius_px: float
    """Of the globe's section."""
    radius_sd_px: float
    rim_ratio: float
    """Apparent size of the rim relative to the section."""
    rim_ratio_sd: float
    wall_ratio: float
    """Outer over inner radius of the rim."""
    wall_ratio_sd: float
    closeness: float
    """Radius of the globe over its distance from the camera."""
    closeness_sd: float
    tilt_sd_deg: float
    """Of each component of the angle between section and sensor, which is designed to be 0."""
    ports_deg: tuple[float, ...]
    ports_sd_deg: float

    def radii_px(self) -> tuple[float, float]:
        """Return the least and the largest radius at which the rim's inner edge is searched."""
        radius_px, reach_px = self.radius_px * self.rim_ratio, NEAR_SD * self.radius_sd_px + SLACK_PX
        return radius_px - reach_px, radius_px + reach_px

    def is_near(self, center_px: Vec, radius_px: float) -> bool:
        """Return whether a circle may be the rim's inner edge."""
        low_px, high_px = self.radii_px()
        return low_px <= radius_px <= high_px and all(
            abs(at - expected) <= NEAR_SD * sd + SLACK_PX
            for at, expected, sd in zip(center_px, self.center_px, self.center_sd_px, strict=True)
        )

    def is_wall(self, wall_ratio: float) -> bool:
        """Return whether two edges may be those of the wall, by the ratio of their radii."""
        return abs(wall_ratio - self.wall_ratio) <= NEAR_SD * self.wall_ratio_sd + WALL_SLACK

    def port_number(self, angle_deg: float) -> int:
        """Return the number of the port nearest to an angle."""
        return min(range(len(self.ports_deg)), key=lambda number: abs(angle_deg - self.ports_deg[number]))

    def off_port_deg(self, angle_deg: float) -> float:
        """Return how far an angle is from the nearest port, positive clockwise."""
        return angle_deg - self.ports_deg[self.port_number(angle_deg)]

    def is_port(self, angle_deg: float) -> bool:
        """Return whether an opening at an angle may be a port."""
        return abs(self.off_port_deg(angle_deg)) <= NEAR_SD * self.ports_sd_deg

    def ports_among(self, angles_deg: Sequence[float]) -> list[bool]:
        """Return which openings may be ports: those near one; else those as far apart as the ports are.

        Others are stains or shadows. Two that keep their distance show that the eye is turned.
        """
        near = [self.is_port(angle_deg) for angle_deg in angles_deg]
        if any(near):
            return near
        apart = [abs(a - b) for a, b in combinations(self.ports_deg, 2)]
        return [
            any(abs(abs(a - b) - d) <= NEAR_SD * self.ports_sd_deg for b in angles_deg for d in apart)
            for a in angles_deg
        ]
