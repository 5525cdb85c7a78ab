"""A simulated eye with a needle that can be put anywhere, and a perceiver that observes it."""

from haptigraph.config import PerceptionConfig
from haptigraph.messages import Capture, Image, Observation
from haptigraph.perception.baseline.threshold import ThresholdPerceiver
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.camera import Camera
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text
from haptigraph.sim.eye.needle import NeedleShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.robot.robot import Pose, Robot, RobotLimits

SETTINGS = CameraSettings(width_px=640, height_px=360, center_px=(320.0, 200.0), px_per_mm=11.0, blur_px=0.6)
STYLES = {
    "light": NeedleShape(),
    "dark": NeedleShape(diameter_mm=0.5, taper_mm=6.0, brightness=0.8, highlight=0.15),
}


class Bench:
    """One eye, one needle, one perceiver."""

    def __init__(
        self, style: str, perceiver: type = ThresholdPerceiver, settings: CameraSettings = SETTINGS, **config
    ) -> None:
        eye = Eye(EyeShape())
        self.settings = settings
        self.camera = Camera(eye, settings, STYLES[style], Appearance(style=style), seed=5)
        text = registration_text(eye, self.camera.geometry, settings.width_px, settings.height_px)
        self.registration = parse_registration(text, "bench")
        self.robot = Robot(eye.trocar_mm, RobotLimits(), Pose(0.0, 0.0))
        self.aim_deg = self.robot.pitch_towards(eye.target_mm)
        self.perceive = perceiver(self.registration, PerceptionConfig(**config))

    def image(self, depth_mm: float, theta_deg: float, number: int = 0) -> Image:
        self.robot.pose = Pose(depth_mm, self.aim_deg + theta_deg)
        return self.camera.render(self.robot.tip_mm(), self.robot.direction(), number)

    def observe(self, image: Image, number: int = 0) -> Observation:
        return self.perceive(Capture(number, round(number * 1e9 / 30), image))

    def look(self, image: Image):
        return self.observe(image).found

    def follow(self, depths_mm, theta_deg: float = 0.0) -> list[Observation]:
        """Observe a needle on its way."""
        return [self.observe(self.image(d, theta_deg, n), n) for n, d in enumerate(depths_mm)]
