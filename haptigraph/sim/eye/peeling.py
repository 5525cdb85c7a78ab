"""Membrane peeling in the phantom: forceps, a membrane and a light pipe, where they are and how they look.

Closed jaws take the membrane's edge along if they closed on it. Knows neither images nor touch beyond that.
"""

from collections.abc import Callable
from typing import NamedTuple

from haptigraph.geometry import Circle, Geometry, Point, Segment, Vec, norm, rotate, subtract, unit
from haptigraph.messages import Image
from haptigraph.sim.eye.camera import Camera
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.forceps import Forceps, ForcepsShape, Instrument
from haptigraph.sim.eye.membrane import Membrane, MembraneShape
from haptigraph.sim.eye.needle import NeedleShape
from haptigraph.sim.robot.operator import LightPipe

__all__ = ["Peeling", "PeelingView"]

CATCH_MM = 0.45  # the edge so near to closing jaws is between them
SHUT_MM = 0.3
PIPE = NeedleShape(
    diameter_mm=0.6, tip_diameter_mm=0.5, taper_mm=0.5, length_mm=45.0, brightness=0.3, highlight=0.2
)


class PeelingView(NamedTuple):
    """One moment of it."""

    hinge_mm: Vec
    """Where the forceps' shaft ends."""
    found: dict[str, Geometry]
    """The true places, by entity name, eye frame."""
    draw: Callable[[Image], None]
    """Draws what the camera does not: jaws, membrane, light pipe."""


class Peeling:
    """Everything of membrane peeling but the robot.

    Args:
        eye: The eye.
        forceps: Their shape.
        membrane: Its shape.
        camera: Takes the pictures.
        seed: Of the metal's grain.
    """

    def __init__(
        self, eye: Eye, forceps: ForcepsShape, membrane: MembraneShape, camera: Camera, seed: int
    ) -> None:
        self._eye, self._camera = eye, camera
        blur_px = camera.settings.blur_px
        self._forceps = Forceps(forceps, camera.frontal, blur_px, seed)
        self._pipe = Instrument(PIPE, camera.frontal, blur_px, seed + 1)
        self._membrane = Membrane(membrane, eye)
        self.restart()

    def restart(self) -> None:
        """Let go, and lie as before."""
        self._membrane.restart()
        self._was_shut = True
        self._holds = False

    def advance(self, tip_mm: Vec, direction: Vec, jaws_mm: float, pipe: LightPipe) -> PeelingView:
        """Move on to the next moment.

        Args:
            tip_mm: Middle between the jaws' tips, eye frame.
            direction: Of the forceps into the eye, length 1, eye frame.
            jaws_mm: Between their tips.
            pipe: Where the other hand holds the light pipe.
        """
        is_shut = jaws_mm <= SHUT_MM
        if is_shut and not self._was_shut:
            self._holds = norm(subtract(self._membrane.edge_mm, tip_mm)) <= CATCH_MM
        self._holds, self._was_shut = self._holds and is_shut, is_shut
        if self._holds:
            self._membrane.pull(tip_mm)
        at = self._forceps.places(tip_mm, direction, jaws_mm)
        rcm_mm = self._eye.other_trocar_mm
        along = rotate(unit((-rcm_mm[0], -rcm_mm[1])), pipe.pipe_deg)
        pipe_mm = rcm_mm[0] + pipe.pipe_depth_mm * along[0], rcm_mm[1] + pipe.pipe_depth_mm * along[1]
        found: dict[str, Geometry] = {
            "forceps_tip": Point(tip_mm),
            "forceps_line": Segment(self._eye.trocar_mm, tip_mm),
            "left_jaw": Point(at.left_mm),
            "right_jaw": Point(at.right_mm),
            "light_pipe_tip": Point(pipe_mm),
            "light_pipe_line": Segment(rcm_mm, pipe_mm),
            "membrane_edge": Point(self._membrane.edge_mm),
        }
        if self._eye.shape.hemorrhage_mm:
            found["hemorrhage"] = Circle(self._eye.hemorrhage_mm, self._eye.shape.hemorrhage_mm / 2)
        camera = self._camera

        def draw(image: Image) -> None:
            self._membrane.draw(image, camera.frontal, camera.light, camera.settings.blur_px)
            self._pipe.draw(image, pipe_mm, along, camera.light, camera.in_view)
            self._forceps.draw(image, at, camera.light, camera.in_view)

        return PeelingView(at.hinge_mm, found, draw)
