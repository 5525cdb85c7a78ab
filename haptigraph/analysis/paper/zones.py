"""Trigger zones: which state the rules conclude for every place of the tip inside the eye.

Every place is an observation of its own, with the shaft from the trocar to the tip, and passes through the
real scene builder and the real rule engine. Positions count as certain.
"""

from typing import TYPE_CHECKING

import cv2
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from haptigraph.analysis.plots.series import Series
from haptigraph.figures import Patch
from haptigraph.geometry import Point, Segment, Vec, norm
from haptigraph.inference.engine import RuleEngine, without_time
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import CERTAIN, Observation
from haptigraph.perception.eye_view import IoctView
from haptigraph.registration.camera import Registration
from haptigraph.scene.builder import SchemaSceneBuilder

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_zones", "zones"]

STEP_PX = 2
"""Of the view, between two places."""
SMOOTH = 1.0
"""Places; takes the steps of the grid out of the borders between zones."""


def zones(
    procedure: Procedure, registration: Registration, view: IoctView, seen: Observation
) -> NDArray[np.int16]:
    """Return the priority of the state for every place of the tip, (n, n); -1 outside the eye.

    Args:
        procedure: Its rules.
        registration: The static anatomy.
        view: The picture that the places are on, every `STEP_PX` pixels.
        seen: What else was observed: the anatomy, the phase.
    """
    build_scene, reason = SchemaSceneBuilder(procedure.schema), RuleEngine(without_time(procedure))
    places = np.arange(0, view.size_px, STEP_PX)
    states = np.full((len(places), len(places)), -1, np.int16)
    for row, y_px in enumerate(places):
        for column, x_px in enumerate(places):
            tip_mm = view.to_mm((float(x_px), float(y_px)))
            if norm(tip_mm) <= registration.globe.radius_mm:
                build_scene.reset()
                states[row, column] = reason(build_scene(_with_tip(seen, registration, tip_mm))).priority
    return states


def _with_tip(seen: Observation, registration: Registration, tip_mm: Vec) -> Observation:
    needle = {"needle_tip": Point(tip_mm), "needle_line": Segment(registration.trocar.at_mm, tip_mm)}
    return replace(seen, found={**seen.found, **needle}, certainty=CERTAIN)


def draw_zones(axes: "Axes", series: Series, states: NDArray[np.int16]) -> list[Patch]:
    """Draw zones, and return the entries of their legend.

    Args:
        axes: With the pixels of the view.
        series: The run.
        states: As `zones` returns them.
    """
    places = np.arange(states.shape[0]) * STEP_PX
    patches = []
    for priority, state in enumerate(series.procedure.states):
        is_here = (states == priority).astype(np.float32)
        if is_here.any():
            color, smooth = series.color(state.name), cv2.GaussianBlur(is_here, (0, 0), SMOOTH)
            axes.contourf(places, places, smooth, levels=(0.45, 1.5), colors=[color])
            axes.contour(places, places, smooth, levels=(0.5,), colors="white", linewidths=0.4)
            label = state.name.replace("_", " ")
            patches.append(Patch(facecolor=color, edgecolor="#555", linewidth=0.4, label=label))
    return patches
