"""The phantom: play a scenario's eye, robot, operator and camera image by image, with the ground truth."""

import math
import sys
from functools import cached_property

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.geometry import Vec, angle_between_deg, norm, subtract
from haptigraph.messages import DepthImage, Image, RobotSample, Truth
from haptigraph.sim.eye.camera import Camera
from haptigraph.sim.eye.cannula import is_in_cannula
from haptigraph.sim.eye.depth import DepthRenderer, needle_in_space
from haptigraph.sim.eye.eye import Eye, registration_text
from haptigraph.sim.eye.optics import image_geometry
from haptigraph.sim.eye.peeling import Peeling
from haptigraph.sim.eye.soft_retina import SoftRetina
from haptigraph.sim.robot.operator import Operator, ScriptedOperator
from haptigraph.sim.robot.readings import SimulatedReadings, robot_setup_text
from haptigraph.sim.robot.robot import Pose, Robot, RobotLimits
from haptigraph.sim.scenario import Scenario

__all__ = ["Moment", "Phantom"]

AWAY_MM = (0.0, 200.0)  # so far that no part of any needle is in view
EXPOSURE_STEPS = tuple(step / 10 for step in range(-5, 6))  # of the exposure time, from its middle
BLANK: Image = np.zeros((1, 1, 3), np.uint8)  # in place of an image that was not drawn


class Moment(Struct, frozen=True, eq=False):
    """One image of the phantom with its ground truth."""

    time_s: float
    image: Image
    truth: Truth
    phase: str = ""
    """Phase of the operation, as named by the script."""
    robot: tuple[RobotSample, ...] = ()
    """What the robot has reported since the previous image, on the phantom's time."""
    depth: DepthImage | None = None


class Phantom:
    """Play a scenario.

    Args:
        scenario: The scenario.
        operator: Moves the robot, from the script's first pose on; None: the scenario's script.
    """

    def __init__(self, scenario: Scenario, operator: Operator | None = None) -> None:
        self.scenario = scenario
        self.eye = Eye(scenario.eye)
        seed = scenario.about.seed
        self.geometry = image_geometry(scenario.camera)
        first, limits = scenario.moves[0], scenario.robot
        aim_deg = Robot(self.eye.trocar_mm, limits, Pose(0.0, 0.0)).pitch_towards(self.eye.target_mm)
        self._start = Pose(first.depth_mm, aim_deg + first.theta_deg, first.jaws_mm)
        self._script = ScriptedOperator(scenario.moves, scenario.operator, limits.motion_scale, seed, aim_deg)
        self.operator: Operator = operator or self._script
        self._peeling = scenario.forceps and Peeling(
            self.eye, scenario.forceps, scenario.membrane, self.camera, seed
        )
        self._soft = scenario.tissue and SoftRetina(scenario.tissue, self.eye)
        given = scenario.readings
        self._readings = SimulatedReadings(given, seed) if given else None
        self.robot_setup = robot_setup_text(given, self.eye.trocar_mm) if given else None
        """The robot's robot.toml; None if it reports nothing."""
        images = self.operator.duration_s * scenario.about.rate_hz
        self.images = max(1, round(images)) if math.isfinite(images) else sys.maxsize
        """Number of images in one run; `sys.maxsize` if it has no end."""
        settings = scenario.camera
        size_px = settings.width_px, settings.height_px
        self._depth = scenario.depth and DepthRenderer(
            self.eye, settings, scenario.needle, scenario.depth, self.geometry, seed
        )
        self.depth_camera = self._depth.camera if self._depth else None
        plane = self._depth.plane if self._depth else None
        self.true_registration = registration_text(self.eye, self.geometry, *size_px, depth=plane)
        """Registration of the true anatomy."""
        error = scenario.registration_error
        self.registration = registration_text(self.eye, self.geometry, *size_px, error, plane)
        """Registration given to perception, with the scenario's errors."""
        self.restart()

    @cached_property
    def camera(self) -> Camera:
        """The camera; its background is painted on first use."""
        given, seed = self.scenario, self.scenario.about.seed
        return Camera(
            self.eye,
            given.camera,
            given.needle,
            given.appearance,
            seed,
            given.distractors,
            given.cannula,
        )

    def paint(self) -> "Phantom":
        """Paint the static background, so that the first image is as quick as the others; return self."""
        _ = self.camera
        return self

    def restart(self) -> None:
        """Return to the start of the scenario."""
        self._robot = Robot(self.eye.trocar_mm, self.scenario.robot, self._start)
        self._next = 0
        if self._peeling:
            self._peeling.restart()
        if self._soft:
            self._soft.restart()
        if self._readings:
            self._readings.restart()

    def advance(self, *, draws: bool = True) -> Moment | None:
        """Advance by one image; return None once the operator is done.

        Args:
            draws: Whether to draw the image; otherwise it is one black pixel.
        """
        moment = self._advance(draws)
        if moment is not None and self._depth and draws:
            moment = self._with_depth(self._depth, moment)
        if moment is not None and self._readings:
            tip_mm, direction = self._robot.tip_mm(), self._robot.direction()
            moment = replace(moment, robot=self._readings.advance(moment.time_s, tip_mm, direction))
        if moment is None or self.operator is not self._script:
            return moment
        return replace(moment, phase=self._script.phase_at(moment.time_s))

    def _advance(self, draws: bool) -> Moment | None:
        if self._next >= self.images:
            return None
        number, self._next = self._next, self._next + 1
        time_s = number / self.scenario.about.rate_hz
        before = self._robot.pose
        if number:
            self.operator.move(self._robot, time_s, 1 / self.scenario.about.rate_hz)
        truth, is_away = self._truth(), self.operator.is_away(time_s)
        warp = self._soft.warp if self._soft else None
        if self._soft:
            elapsed_s = 1 / self.scenario.about.rate_hz if number else 0.0
            self._soft.advance(elapsed_s, None if is_away else truth.tip_mm)
            truth = replace(truth, others={"retina_surface": self._soft.surface()})
        if is_away:
            image = self.camera.render(AWAY_MM, (0.0, -1.0), number, warp=warp) if draws else BLANK
            return Moment(time_s, image, replace(truth, visible=False, inside=False))
        direction = self._robot.direction()
        if self._peeling:
            pipe = self._script.pipe_at(time_s if self.operator is self._script else 0.0)
            view = self._peeling.advance(truth.tip_mm, direction, self._robot.pose.jaws_mm, pipe)
            image = self.camera.render(view.hinge_mm, direction, number, view.draw) if draws else BLANK
            return Moment(time_s, image, replace(truth, others=view.found))
        if not draws:
            return Moment(time_s, BLANK, truth)
        exposure = self._exposure(before)
        image = self.camera.render(truth.tip_mm, direction, number, warp=warp, exposure=exposure)
        return Moment(time_s, image, truth)

    def _with_depth(self, renderer: DepthRenderer, moment: Moment) -> Moment:
        """Add the depth image, and the shaft in space to the ground truth."""
        scenario, truth = self.scenario, moment.truth
        is_away = self.operator.is_away(moment.time_s)
        shaft = None if is_away else needle_in_space(truth.tip_mm, self.eye, scenario.needle, scenario.camera)
        depth = renderer.render(shaft, self._next - 1)
        if shaft is not None:
            truth = replace(truth, others={**truth.others, "needle_3d": shaft})
        return replace(moment, depth=depth, truth=truth)

    def _exposure(self, before: Pose) -> list[tuple[Vec, Vec]]:
        """Return the needle's tips [mm] and directions while the shutter is open, at its latest speed."""
        now, share = self._robot.pose, self.scenario.camera.shutter_s * self.scenario.about.rate_hz
        if not share or now == before:
            return []
        poses = []
        for when in EXPOSURE_STEPS:
            pose = Pose(
                now.depth_mm + when * share * (now.depth_mm - before.depth_mm),
                now.pitch_deg + when * share * (now.pitch_deg - before.pitch_deg),
            )
            robot = Robot(self.eye.trocar_mm, RobotLimits(depth_min_mm=-100, depth_max_mm=100), pose)
            poses.append((robot.tip_mm(), robot.direction()))
        return poses

    def _truth(self) -> Truth:
        tip_mm, direction = self._robot.tip_mm(), self._robot.direction()
        distance_mm = norm(tip_mm)
        tip_px = self.geometry.to_px(tip_mm)
        settings = self.scenario.camera
        in_image = 0 <= tip_px[0] < settings.width_px and 0 <= tip_px[1] < settings.height_px
        in_wall = self.eye.radius_mm <= distance_mm <= self.eye.radius_mm + self.scenario.eye.wall_mm
        depth_mm, cannula = self._robot.pose.depth_mm, self.scenario.cannula
        in_cannula = cannula is not None and is_in_cannula(cannula, self.eye, depth_mm)
        axis = subtract(self.eye.target_mm, self.eye.trocar_mm)
        return Truth(
            visible=in_image and not in_wall and not in_cannula,
            inside=distance_mm < self.eye.radius_mm,
            tip_px=tip_px,
            tip_mm=tip_mm,
            depth_mm=depth_mm,
            theta_deg=angle_between_deg(direction, axis),
        )
