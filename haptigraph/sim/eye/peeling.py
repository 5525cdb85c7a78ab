"""Membrane peeling in the phantom: positions and drawing of forceps, membrane and light pipe.

Jaws that close on the membrane's edge take it along until they open.
"""

from collections.abc import Callable
from typing import NamedTuple

from haptigraph.geometry import Circle, Geometry, Point, Segment, Vec, norm, subtract
from haptigraph.messages import Image
from haptigraph.sim.eye.camera import Camera
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.forceps import Forceps, ForcepsShape, Instrument
from haptigraph.sim.eye.membrane import Membrane, MembraneShape
from haptigraph.sim.eye.needle import NeedleShape
from haptigraph.sim.robot.operator import LightPipe

__all__ = ["Peeling", "PeelingView"]

GRASP_MM = 0.45  # closing jaws grasp an edge within this distance
CLOSED_MM = 0.3
PIPE = NeedleShape(
    diameter_mm=0.6, tip_diameter_mm=0.5, taper_mm=0.5, length_mm=45.0, brightness=0.3, highlight=0.2
)


class PeelingView(NamedTuple):
    """The scene at one moment."""

    hinge_mm: Vec
    """End of the forceps' shaft."""
    found: dict[str, Geometry]
    """Ground truth by entity name, eye frame."""
    draw: Callable[[Image], None]
    """Draws what the camera does not: jaws, membrane, light pipe."""


class Peeling:
    """Forceps, membrane and light pipe of one scenario.

    Args:
        eye: The eye.
        forceps: Shape of the forceps.
        membrane: Shape of the membrane.
        camera: Renders the images.
        seed: Seed of the metal's grain.
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
        """Release the membrane and return it to its initial position."""
        self._membrane.restart()
        self._was_closed = True
        self._has_grasped = False

    def advance(self, tip_mm: Vec, direction: Vec, jaws_mm: float, pipe: LightPipe) -> PeelingView:
        """Advance to the next moment.

        Args:
            tip_mm: Midpoint between the tips of the jaws, eye frame.
            direction: Direction of the forceps into the eye, length 1, eye frame.
            jaws_mm: Distance between the tips of the jaws.
            pipe: Pose of the light pipe in the other hand.
        """
        is_closed = jaws_mm <= CLOSED_MM
        if is_closed and not self._was_closed:
            self._has_grasped = norm(subtract(self._membrane.edge_mm, tip_mm)) <= GRASP_MM
        self._has_grasped, self._was_closed = self._has_grasped and is_closed, is_closed
        if self._has_grasped:
            self._membrane.pull(tip_mm)
        at = self._forceps.positions(tip_mm, direction, jaws_mm)
        pipe_mm, along = self._eye.second_instrument(pipe.pipe_depth_mm, pipe.pipe_deg)
        found: dict[str, Geometry] = {
            "forceps_tip": Point(tip_mm),
            "forceps_line": Segment(self._eye.trocar_mm, tip_mm),
            "left_jaw": Point(at.left_mm),
            "right_jaw": Point(at.right_mm),
            "light_pipe_tip": Point(pipe_mm),
            "light_pipe_line": Segment(self._eye.other_trocar_mm, pipe_mm),
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
