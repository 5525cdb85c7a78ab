"""Move the needle of an observation about its trocar: a turn, then a motion along the shaft."""

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from haptigraph.geometry import Circle, Geometry, Point, Segment, Vec, norm, rotate, subtract, unit
from haptigraph.messages import Observation

__all__ = ["LINE", "PITCH_LIMIT_DEG", "TIP", "Needle", "needle_of"]

TIP, LINE, ROBOT_TIP = "needle_tip", "needle_line", "robot_tip"
PITCH_LIMIT_DEG = 50.0
"""To either side of the line from the trocar to the globe's centre; beyond it the wall is in the way."""
WITHDRAWN_MM = 5.0  # the tip may be drawn back so far outside the trocar
BEYOND_MM = 2.0  # the tip may be advanced so far beyond the globe's diameter, past the wall


class Needle(Struct, frozen=True):
    """Needle that pivots about its trocar, in the section."""

    observation: Observation
    tip_mm: Vec
    line: Segment
    along: Vec
    """Direction of the shaft into the eye, length 1."""
    trocar_mm: Vec
    globe: Circle

    @property
    def depth_mm(self) -> float:
        """From the trocar to the tip along the shaft; negative outside."""
        offset = subtract(self.tip_mm, self.trocar_mm)
        return offset[0] * self.along[0] + offset[1] * self.along[1]

    @property
    def mm_per_deg(self) -> float:
        """Arc that a turn of 1 degree moves the tip at its current depth."""
        return math.radians(norm(subtract(self.tip_mm, self.trocar_mm)))

    @property
    def turn_range_deg(self) -> tuple[float, float]:
        """Largest turns clockwise (negative) and counter-clockwise."""
        inwards = subtract(self.globe.center_mm, self.trocar_mm)
        cross = inwards[0] * self.along[1] - inwards[1] * self.along[0]
        dot = inwards[0] * self.along[0] + inwards[1] * self.along[1]
        pitch_deg = math.degrees(math.atan2(cross, dot))
        return min(-PITCH_LIMIT_DEG - pitch_deg, 0.0), max(PITCH_LIMIT_DEG - pitch_deg, 0.0)

    @property
    def advance_range_mm(self) -> tuple[float, float]:
        """Largest motions out of the eye (negative) and into it."""
        deepest_mm = 2 * self.globe.radius_mm + BEYOND_MM
        return min(-WITHDRAWN_MM - self.depth_mm, 0.0), max(deepest_mm - self.depth_mm, 0.0)

    def moved(self, turn_deg: float, advance_mm: float) -> Observation:
        """Return the observation after a turn (counter-clockwise) and a motion along the shaft.

        Everything stays where it is but the needle and the tip that its robot reports; so do the standard
        deviations.
        """
        along = rotate(self.along, turn_deg)

        def at(point_mm: Vec) -> Vec:
            x, y = rotate(subtract(point_mm, self.trocar_mm), turn_deg)
            return (
                self.trocar_mm[0] + x + advance_mm * along[0],
                self.trocar_mm[1] + y + advance_mm * along[1],
            )

        line = Segment(at(self.line.start_mm), at(self.line.end_mm))
        found: dict[str, Geometry] = {TIP: Point(at(self.tip_mm)), LINE: line}
        if isinstance(robot_tip := self.observation.found.get(ROBOT_TIP), Point):
            found[ROBOT_TIP] = Point(at(robot_tip.at_mm), robot_tip.z_mm)
        return replace(self.observation, found=self.observation.found | found)

    def swept(
        self, turn_deg: NDArray[np.float64], advance_mm: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return tips [mm] and directions of the shaft after many motions.

        Args:
            turn_deg: Turns, any shape.
            advance_mm: Motions along the shaft, of a shape that broadcasts with it.

        Returns:
            The tips and the directions, (2, ...) each, x and y first.
        """
        cos, sin = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
        (u, v), (x, y) = self.along, subtract(self.tip_mm, self.trocar_mm)
        along = np.stack(np.broadcast_arrays(cos * u - sin * v, sin * u + cos * v, advance_mm)[:2])
        tip_x = self.trocar_mm[0] + cos * x - sin * y + advance_mm * along[0]
        tip_y = self.trocar_mm[1] + sin * x + cos * y + advance_mm * along[1]
        return np.stack([tip_x, tip_y]), along


def needle_of(observation: Observation) -> Needle | None:
    """Return the needle of an observation; None without tip, shaft, trocar or globe."""
    found = observation.found
    tip, line, trocar, globe = (found.get(name) for name in (TIP, LINE, "trocar", "eye_globe"))
    if not (isinstance(tip, Point) and isinstance(line, Segment)):
        return None
    if not (isinstance(trocar, Point) and isinstance(globe, Circle)) or line.start_mm == line.end_mm:
        return None
    along = unit(subtract(line.end_mm, line.start_mm))
    return Needle(observation, tip.at_mm, line, along, trocar.at_mm, globe)
