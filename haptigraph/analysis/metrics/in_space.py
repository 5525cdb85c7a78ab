"""How far the needle was out of the section, where depth shows it."""

from msgspec import Struct

from haptigraph.geometry import Segment
from haptigraph.messages import Observation
from haptigraph.perception.entities import NEEDLE_3D

__all__ = ["InSpace", "in_space_text", "out_of_section"]


def out_of_section(observation: Observation) -> tuple[float, float, float, float] | None:
    """Return the tip's z [mm], the shaft's angle to the section [deg], and their standard deviations.

    Both are positive towards the camera; None if no depth shows the shaft.
    """
    shaft, certainty = observation.found.get(NEEDLE_3D), observation.certainty
    sd_mm = observation.sd_mm.get(NEEDLE_3D)
    if not isinstance(shaft, Segment) or not isinstance(sd_mm, float) or certainty is None:
        return None
    if (angle_sd_deg := certainty.out_of_plane_sd_deg) is None:
        return None
    return shaft.end_z_mm, shaft.out_of_plane_deg, sd_mm, angle_sd_deg


def in_space_text(observation: Observation) -> str:
    """Return where the needle is out of the section, as text; empty if no depth shows it."""
    found = out_of_section(observation)
    if found is None:
        return ""
    z_mm, angle_deg, sd_mm, angle_sd_deg = found
    side = "towards the camera" if z_mm > 0 else "away from the camera"
    return f"tip {abs(z_mm):.1f} ± {sd_mm:.1f} mm {side}, shaft {abs(angle_deg):.1f} ± {angle_sd_deg:.1f}°"


class InSpace(Struct):
    """The greatest distance of a run; `add` its observations in order."""

    tips: int = 0
    """Observations with a tip."""
    measured: int = 0
    """Of those, how many show the needle in space."""
    farthest: str = ""
    farthest_mm: float = 0.0

    def add(self, observation: Observation) -> None:
        """Process the next observation."""
        self.tips += "needle_tip" in observation.found
        found = out_of_section(observation)
        if found is None:
            return
        self.measured += 1
        if self.measured == 1 or abs(found[0]) > self.farthest_mm:
            self.farthest_mm, self.farthest = abs(found[0]), in_space_text(observation)

    @property
    def lines(self) -> list[str]:
        """Lines of a summary; none without depth."""
        if not self.measured:
            return []
        share = f"known in {self.measured} of {self.tips} steps with a tip"
        return [f"out of plane    at most: {self.farthest}; {share}"]
