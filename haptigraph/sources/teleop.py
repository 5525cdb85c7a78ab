"""Images of the simulated phantom while a hand steers its robot, with the truth and the hand beside each."""

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

    It never ends, and an image shows what the hand did until it was read; so it must not be read ahead.

    Args:
        name: Of the scenario whose eye, camera, robot and needle they are, or the path of a .toml file.

    Raises:
        BadInput: If there is no such scenario, or its images are too few for the tremor filter.
    """

    is_live = False

    def __init__(self, name: str) -> None:
        scenario = load_scenario(name)
        self.rate_hz = scenario.about.rate_hz
        if self.rate_hz < LOWEST_RATE_HZ:
            problem = (
                f"rate_hz {self.rate_hz:g} is too slow to be steered; at least {LOWEST_RATE_HZ:g} is needed"
            )
            raise BadInput(problem, name, "scenario.rate_hz")
        settings = TeleopSettings(motion_scale=scenario.robot.motion_scale)
        self.teleop = Teleop(self.rate_hz, settings, scenario.about.seed)
        """Where hand motion goes, and the settings; from any thread."""
        self._phantom = Phantom(scenario, self.teleop)
        self._index = -1
        self.registration: str | None = self._phantom.registration

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next image."""
        moment = self._phantom.advance()
        if moment is None:
            raise EndOfSource
        self._index += 1
        stamp_ns = round(self._index * 1e9 / self.rate_hz)
        return Capture(self._index, stamp_ns, moment.image, truth=moment.truth, hand=self.teleop.hand)

    def close(self) -> None:
        """Do nothing: nothing stays open."""
