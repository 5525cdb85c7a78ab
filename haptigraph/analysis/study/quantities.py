"""The outcomes of a study: names, units, and the families in which they are tested.

A family is a set of hypotheses corrected together (Holm). The first is the paper's table.
"""

from collections.abc import Iterable

from msgspec import Struct

__all__ = ["FAMILIES", "QUANTITIES", "Quantity", "state_of", "state_quantities", "words"]

FAMILIES = {
    "primary": "the paper's measures",
    "states": "time in each surgical state",
    "secondary": "further measures",
    "questionnaires": "further questionnaires",
}


class Quantity(Struct, frozen=True):
    """One outcome that is compared between conditions."""

    name: str
    """Name of its column."""
    label: str
    unit: str
    family: str
    decimals: int = 1
    needs_touch: bool = False
    """Whether it is 0 by construction in a condition without haptic output."""

    @property
    def title(self) -> str:
        """Label with unit, for axes and tables."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


QUANTITIES = (
    Quantity("completion_s", "Completion Time", "s", "primary"),
    Quantity("mean_theta_deg", "Alignment Angle", "°", "primary"),
    Quantity("sus", "SUS Score", "0-100", "primary"),
    Quantity("contacts", "Unintended Contacts", "", "secondary", 2),
    Quantity("path_mm", "Path Length", "mm", "secondary"),
    Quantity("sparc", "Smoothness (SPARC)", "", "secondary", 2),
    Quantity("log_jerk", "Log Dimensionless Jerk", "", "secondary", 2),
    Quantity("tremor_power_mm2", "Tremor Power", "mm²", "secondary", 4),
    Quantity("vibrating_s", "Time Vibrating", "s", "secondary", needs_touch=True),
    Quantity("reaction_ms", "Reaction Time", "ms", "secondary", 0),
    Quantity("approach_speed_mm_s", "Approach Speed", "mm/s", "secondary", 2),
)


def words(name: str) -> str:
    """Return a name in prose: `visual_only` as `Visual only`."""
    text = name.replace("_", " ")
    return text[:1].upper() + text[1:]


def state_of(column: str) -> str:
    """Return the state of a column `time_<state>_s`, otherwise ""."""
    is_time = column.startswith("time_") and column.endswith("_s")
    return column[len("time_") : -len("_s")] if is_time else ""


def state_quantities(columns: Iterable[str]) -> list[Quantity]:
    """Return the times per state among the columns of `trials`."""
    return [
        Quantity(column, f"Time in {state_of(column).replace('_', ' ')}", "s", "states")
        for column in columns
        if state_of(column)
    ]
