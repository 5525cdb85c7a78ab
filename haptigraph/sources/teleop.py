"""Images of the simulated phantom while a hand steers its robot, with the truth and the hand beside each."""

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Capture
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario
from haptigraph.teleop.band_stop import LOWEST_RATE_HZ
from haptigraph.teleop.motion import TeleopSettings
from haptigraph.teleop.teleop import Teleop

__all__ = ["TeleopSource"]


class TeleopSource:
    """A phantom without script: the needle stands where the scenario begins until `teleop` moves it.

    It never ends. Like a camera it is live: each image has its moment on the run's clock, and shows what the
    hand did until then, so it is made then and not before. A moment that has passed is left out.

    Args:
        name: Of the scenario whose eye, camera, robot and needle they are, or the path of a .toml file.
        clock: Tells when images are due, and stamps them.
        target_mm: Where the target lies along the retina; None: as the scenario says.

    Raises:
        BadInput: If there is no such scenario, or its images are too few for the tremor filter.
    """

    is_live = True

    def __init__(self, name: str, clock: Clock, target_mm: float | None = None) -> None:
        scenario = load_scenario(name, target_mm)
        self.rate_hz = scenario.about.rate_hz
        if self.rate_hz < LOWEST_RATE_HZ:
            problem = (
                f"rate_hz {self.rate_hz:g} is too slow to be steered; at least {LOWEST_RATE_HZ:g} is needed"
            )
            raise BadInput(problem, name, "scenario.rate_hz")
        settings = TeleopSettings(motion_scale=scenario.robot.motion_scale)
        has_jaws = scenario.forceps is not None
        self.teleop = Teleop(self.rate_hz, settings, scenario.about.seed, has_jaws=has_jaws)
        """Where hand motion goes, and the settings; from any thread."""
        self._phantom = Phantom(scenario, self.teleop).paint()
        self._clock = clock
        self._start_ns: int | None = None
        self._index = -1
        self.registration: str | None = self._phantom.registration

    def read(self, timeout_s: float) -> Capture | None:
        """Wait until the next image is due, and return it."""
        now_ns = self._clock.now_ns()
        if self._start_ns is None:
            self._start_ns = now_ns
        passed = int((now_ns - self._start_ns) * self.rate_hz / 1e9)
        self._index = max(self._index + 1, passed)
        self._clock.wait_until(self._start_ns + round(self._index * 1e9 / self.rate_hz))
        moment = self._phantom.advance()
        if moment is None:
            raise EndOfSource
        stamp_ns = self._clock.now_ns()
        return Capture(self._index, stamp_ns, moment.image, truth=moment.truth, hand=self.teleop.hand)

    def close(self) -> None:
        """Do nothing: nothing stays open."""
