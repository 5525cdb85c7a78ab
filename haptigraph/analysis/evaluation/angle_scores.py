"""Score the angle of a shaft: its error, shallow and deep, and whether its certainty is true."""

from collections.abc import Callable, Sequence

from haptigraph.analysis.evaluation.ground_truth import TruthRow
from haptigraph.analysis.evaluation.tip_scores import spread
from haptigraph.messages import Step

__all__ = ["SHALLOW_MM", "AngleError", "angle_spreads", "angle_z", "theta_error_deg"]

SHALLOW_MM = (1.0, 3.0)
"""Depths of a shallow shaft; beyond, it is deep."""

MIN_SD_DEG = 1e-6  # of an angle that is certain: its error counts all the same

AngleError = Callable[[Step, TruthRow], float | None]
"""Absolute error of a step's angle [deg]; None if it has no angle."""


def theta_error_deg(step: Step, row: TruthRow) -> float | None:
    """Return the absolute error of theta."""
    theta_deg = step.graph.measures.get("theta_deg")
    return None if theta_deg is None or row.theta_deg is None else abs(theta_deg - row.theta_deg)


def angle_z(step: Step, error_deg: float | None) -> float | None:
    """Return an angle's error per reported standard deviation; None without either."""
    certainty = step.observation.certainty
    if error_deg is None or certainty is None:
        return None
    return error_deg / max(certainty.theta_sd_deg, MIN_SD_DEG)


def angle_spreads(angles_deg: Sequence[tuple[float, float]]) -> dict[str, dict[str, float | None]]:
    """Summarise (depth [mm], error [deg]) pairs, shallow and deep."""
    low, high = SHALLOW_MM
    return {
        "shallow": spread([error for depth, error in angles_deg if low <= depth <= high]),
        "deep": spread([error for depth, error in angles_deg if depth > high]),
    }
