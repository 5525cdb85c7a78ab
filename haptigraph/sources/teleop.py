"""Images of the simulated phantom under teleoperation, each with ground truth and hand motion."""

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario
from haptigraph.sources.phantom import capture_of
from haptigraph.stages import Source
from haptigraph.teleop.band_stop import MIN_RATE_HZ
from haptigraph.teleop.motion import TeleopSettings
from haptigraph.teleop.teleop import Teleop

__all__ = ["TeleopSource"]


class TeleopSource(Source):
    """A phantom without script: the needle stays where the scenario starts until `teleop` moves it.

    The source never ends. It is live like a camera: an image is drawn when it is due on the run's clock, so
    that it shows the hand's motion until then; images that are overdue are skipped.

    Args:
        name: The scenario that defines eye, camera, robot and needle, or the path of a .toml file.
        clock: Schedules and stamps the images.
        target_mm: Position of the target along the retina; None: the scenario's own.

    Raises:
        BadInput: If there is no such scenario, or its image rate is too low for the tremor filter.
    """

    is_live = True

    def __init__(self, name: str, clock: Clock, target_mm: float | None = None) -> None:
        scenario = load_scenario(name, target_mm)
        self.rate_hz = scenario.about.rate_hz
        if self.rate_hz < MIN_RATE_HZ:
            problem = f"rate_hz {self.rate_hz:g} is too low to be steered; use at least {MIN_RATE_HZ:g}"
            raise BadInput(problem, name, "scenario.rate_hz")
        settings = TeleopSettings(motion_scale=scenario.robot.motion_scale)
        has_jaws = scenario.forceps is not None
        self.teleop = Teleop(self.rate_hz, settings, scenario.about.seed, has_jaws=has_jaws)
        """Takes the hand's motion and the settings, from any thread."""
        self._phantom = Phantom(scenario, self.teleop).paint()
        self._clock = clock
        self._start_ns: int | None = None
        self._index = -1
        self.registration, self.robot_setup = self._phantom.registration, self._phantom.robot_setup
        self.depth_camera = self._phantom.depth_camera

    def read(self, timeout_s: float) -> Capture | None:
        """Wait until the next image is due, and return it."""
        now_ns = self._clock.now_ns()
        if self._start_ns is None:
            self._start_ns = now_ns
        due = int((now_ns - self._start_ns) * self.rate_hz / 1e9)
        self._index = max(self._index + 1, due)
        self._clock.wait_until(self._start_ns + round(self._index * 1e9 / self.rate_hz))
        moment = self._phantom.advance()
        if moment is None:
            raise EndOfSource
        stamp_ns = self._clock.now_ns()
        return capture_of(moment, self._index, stamp_ns, self.teleop.hand)

    def close(self) -> None:
        """Do nothing: the phantom holds no resources."""
