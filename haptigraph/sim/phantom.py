"""The phantom: eye, robot, operator and camera of one scenario, played image by image, with the truth."""

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.geometry import angle_between_deg, norm, subtract
from haptigraph.messages import Image, Truth
from haptigraph.sim.camera import Camera
from haptigraph.sim.eye import Eye, registration_text
from haptigraph.sim.operator import ScriptedOperator
from haptigraph.sim.robot import Pose, Robot
from haptigraph.sim.scenario import Scenario

__all__ = ["Moment", "Phantom"]

AWAY_MM = (0.0, 200.0)  # no part of any needle is in view
MOTION_STEPS = 4  # the robot moves in finer steps than the camera sees


class Moment(Struct, frozen=True, eq=False):
    """One image of the phantom and what it shows."""

    time_s: float
    image: Image
    truth: Truth


class Phantom:
    """Play a scenario.

    Args:
        scenario: The scenario.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.eye = Eye(scenario.eye)
        seed = scenario.about.seed
        self.camera = Camera(
            self.eye, scenario.camera, scenario.needle, scenario.look, seed, scenario.distractors
        )
        self.operator = ScriptedOperator(scenario.moves, scenario.operator, scenario.robot.motion_scale, seed)
        self.images = max(1, round(self.operator.duration_s * scenario.about.rate_hz))
        """How many images one play has."""
        settings = scenario.camera
        size_px = settings.width_px, settings.height_px
        self.true_registration = registration_text(self.eye, self.camera.geometry, *size_px)
        """Where everything is."""
        self.registration = registration_text(
            self.eye, self.camera.geometry, *size_px, scenario.registration_error
        )
        """What perception is told."""
        self.restart()

    def restart(self) -> None:
        """Go back to the scenario's beginning."""
        depth_mm, theta_deg = self.operator.pose_at(0.0)
        self._robot = Robot(self.eye.trocar_mm, self.scenario.robot, Pose(0.0, 0.0))
        self._target_pitch_deg = self._robot.pitch_towards(self.eye.target_mm)
        start = Pose(depth_mm, self._target_pitch_deg + theta_deg)
        self._robot = Robot(self.eye.trocar_mm, self.scenario.robot, start)
        self._next = 0

    def advance(self) -> Moment | None:
        """Play on by one image; None when the script is over."""
        if self._next >= self.images:
            return None
        number, self._next = self._next, self._next + 1
        step_s = 1 / self.scenario.about.rate_hz / MOTION_STEPS
        time_s = number / self.scenario.about.rate_hz
        for step in range(MOTION_STEPS if number else 0):
            then_s = time_s - (MOTION_STEPS - 1 - step) * step_s
            self._robot.follow(self.operator.wanted(then_s, self._target_pitch_deg), step_s)
        truth = self._truth()
        if self.operator.is_away(time_s):
            image = self.camera.render(AWAY_MM, (0.0, -1.0), number)
            return Moment(time_s, image, replace(truth, visible=False, inside=False))
        image = self.camera.render(truth.tip_mm, self._robot.direction(), number)
        return Moment(time_s, image, truth)

    def _truth(self) -> Truth:
        tip_mm, direction = self._robot.tip_mm(), self._robot.direction()
        distance_mm = norm(tip_mm)
        tip_px = self.camera.geometry.to_px(tip_mm)
        settings = self.scenario.camera
        in_image = 0 <= tip_px[0] < settings.width_px and 0 <= tip_px[1] < settings.height_px
        in_wall = self.eye.radius_mm <= distance_mm <= self.eye.radius_mm + self.scenario.eye.wall_mm
        axis = subtract(self.eye.target_mm, self.eye.trocar_mm)
        return Truth(
            visible=in_image and not in_wall,
            inside=distance_mm < self.eye.radius_mm,
            tip_px=tip_px,
            tip_mm=tip_mm,
            depth_mm=self._robot.pose.depth_mm,
            theta_deg=angle_between_deg(direction, axis),
        )
