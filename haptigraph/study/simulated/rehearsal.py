"""One trial of a simulated participant: person, hand, robot, eye and the real pipeline in a closed loop.

Turns participant, condition and seed into the steps of a run and what the hand felt. Graph, rules, touch,
guard and teleoperation are those of any run; perception runs on rendered images, or is the ground truth with
noise. All runs on a virtual clock: the same seed gives the same steps, bit for bit. Knows no statistics.
"""

import math
from collections.abc import Generator, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.clock import VirtualClock
from haptigraph.config import Config
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.haptics.guard import Guard
from haptigraph.messages import Capabilities, Capture, Step
from haptigraph.pipeline import Loop
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.sim.eye.eye import Eye, EyeShape
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.operator import Move
from haptigraph.sim.robot.robot import Pose, Robot, RobotLimits
from haptigraph.sim.scenario import About, Scenario
from haptigraph.sources.jpeg import JpegSource
from haptigraph.stages import Sink, Source
from haptigraph.study.simulated.ground_truth import GroundTruthPerceiver
from haptigraph.study.simulated.participant import Participant
from haptigraph.study.simulated.person import SimulatedPerson
from haptigraph.study.simulated.training import lesson
from haptigraph.teleop.motion import HandMotion, TeleopSettings
from haptigraph.teleop.teleop import LEVER_MM, Teleop

__all__ = ["KNOWN", "NO_TOUCH", "SHIPPED", "Condition", "Rehearsal", "coming_in", "draw_scenario"]

KNOWN = "known"
"""In place of a perceiver: the simulator's truth with the tracker's measured noise."""
START_MM = 3.0
LIMIT_S = 180.0
AFTER_NS = 1_500_000_000  # so long the hand may feel that the target is hit
HIT = "target_hit"


class Condition(Struct, frozen=True):
    """What a participant is given."""

    name: str
    procedure: str
    max_amplitude: float = 1.0
    """The guard's limit; 0: nothing is felt."""
    text: str = ""
    """The procedure, whole, for machines that lack the file; empty: as the name says."""


NO_TOUCH = Condition("no touch", "subretinal_injection", 0.0)
SHIPPED = (
    NO_TOUCH,
    Condition("binary", "subretinal_injection"),
    Condition("continuous", "subretinal_injection_continuous"),
)
"""The paper's two conditions, and the one it asks for."""


class Rehearsal:
    """One trial, from the needle in the eye to the target.

    Args:
        participant: Who.
        condition: With which touch.
        scenario: Eye, camera, robot, and where the needle begins; see `draw_scenario`.
        seed: Of all noise of this trial; the same in every condition.
        perceiver: Name of a perceiver, which gets drawn images, or `KNOWN`.
        config: All else that the run depends on.
        limit_s: When time is up.
        sinks: Further takers of steps.

    Raises:
        BadInput: If the procedure has no target to hit.
    """

    def __init__(
        self,
        participant: Participant,
        condition: Condition,
        scenario: Scenario,
        seed: tuple[int, ...],
        *,
        perceiver: str = KNOWN,
        config: Config | None = None,
        limit_s: float = LIMIT_S,
        sinks: Sequence[Sink] = (),
    ) -> None:
        config = config or Config()
        self.config = replace(
            config,
            haptics=replace(config.haptics, max_amplitude=condition.max_amplitude),
            run=replace(config.run, procedure=condition.procedure),
            perception=replace(config.perception, perceiver=perceiver),
        )
        self.procedure = (
            assemble.parse_procedure(condition.text, condition.procedure)
            if condition.text
            else assemble.load_procedure(condition.procedure)
        )
        if HIT not in [state.name for state in self.procedure.states]:
            problem = f"has no state {HIT}; simulated participants know no other task than to hit a target"
            raise BadInput(problem, f"procedure {condition.procedure}")
        eye = Eye(scenario.eye)
        axis_mm = math.dist(eye.trocar_mm, eye.target_mm)
        source = _SteeredSource(scenario, perceiver != KNOWN, limit_s)
        self.registration = parse_camera_registration(source.registration or "", "the simulated eye")
        known = GroundTruthPerceiver(self.registration, (*seed, 1)) if perceiver == KNOWN else None
        taught = lesson(self.procedure.text, condition.max_amplitude)
        self.person = SimulatedPerson(participant, taught, axis_mm, (*seed, 2))
        source.begin(self.person)
        quality = self.config.source.jpeg_quality
        seen: Source = source if known or not quality else JpegSource(source, quality)
        self.felt: list[tuple[int, float]] = []
        """Every change of the device: (stamp_ns, amplitude)."""
        self.is_hit = False
        """Whether the target was hit."""
        self.loop = Loop(
            assemble.build_pipeline(self.config, self.registration, self.procedure, known),
            source=seen,
            hand=Guard(_Skin(self.person, self.felt), self.config.haptics),
            sinks=sinks,
            clock=VirtualClock(),
        )

    def steps(self) -> Generator[Step, None, None]:
        """Yield the steps until the target was hit, and a moment longer, or time is up."""
        hit_ns: int | None = None
        for step in self.loop.steps():
            yield step
            if hit_ns is None and step.conclusion.state == HIT:
                hit_ns, self.is_hit = step.stamp_ns, True
            if hit_ns is not None and step.stamp_ns - hit_ns >= AFTER_NS:
                return


def draw_scenario(seed: tuple[int, ...], *, rate_hz: float = 30.0) -> Scenario:
    """Draw where target and trocar lie; the needle has just come in, at right angles to the wall.

    The places are those of `sim.scenes`. How far the needle then points beside the target follows from them.

    Args:
        seed: Of the places.
        rate_hz: Images per second.
    """
    rng = np.random.default_rng((*seed, 0))
    side = float(rng.choice((-1, 1)))
    shape = EyeShape(target_deg=rng.uniform(-15, 15), trocar_deg=side * rng.uniform(28, 42))
    return coming_in(shape, int(rng.integers(2**31)), rate_hz=rate_hz)


def coming_in(shape: EyeShape, seed: int, *, rate_hz: float = 30.0) -> Scenario:
    """Return a scenario that begins with the needle just come in, at right angles to the wall."""
    eye, limits = Eye(shape), RobotLimits()
    aim_deg = Robot(eye.trocar_mm, limits, Pose(0.0, 0.0)).pitch_towards(eye.target_mm)
    about = About(description="A trial of a simulated participant.", seed=seed, rate_hz=rate_hz)
    return Scenario(about=about, moves=(Move(1.0, START_MM, -aim_deg),), eye=shape, robot=limits)


class _Steered:
    """The person as the operator of the phantom, by way of teleoperation."""

    def __init__(
        self, person: SimulatedPerson, scenario: Scenario, target_pitch_deg: float, limit_s: float
    ) -> None:
        self.duration_s = limit_s
        self._person, self._aim_deg = person, target_pitch_deg
        self._scale = scenario.robot.motion_scale
        settings = TeleopSettings(motion_scale=self._scale)
        self.teleop = Teleop(scenario.about.rate_hz, settings, scenario.about.seed)

    def move(self, robot: Robot, time_s: float, elapsed_s: float) -> None:
        motion = self._person.act(time_s, elapsed_s)
        depth_mm = robot.pose.depth_mm
        lever_mm = max(depth_mm**2, LEVER_MM**2) / depth_mm
        along_mm, across_mm = motion.along_mm, lever_mm * math.radians(motion.turn_deg)
        shook_along_mm, shook_across_mm = motion.tremor_mm
        self.teleop.put(
            HandMotion(
                True, along_mm / self._scale + shook_along_mm, across_mm / self._scale + shook_across_mm
            )
        )
        self.teleop.move(robot, time_s, elapsed_s)
        self._person.see(time_s, robot.pose.depth_mm, robot.pose.pitch_deg - self._aim_deg)

    def is_away(self, time_s: float) -> bool:
        return False


class _SteeredSource(Source):
    """Images of the phantom, drawn or not, while the person steers."""

    is_live = False

    def __init__(self, scenario: Scenario, draws: bool, limit_s: float) -> None:
        self._scenario, self._draws, self._limit_s = scenario, draws, limit_s
        self._phantom = Phantom(scenario)
        self.rate_hz = scenario.about.rate_hz
        self.registration: str | None = self._phantom.registration
        self._index = -1

    def begin(self, person: SimulatedPerson) -> None:
        """Put a person at the controls."""
        eye = self._phantom.eye
        aim_deg = Robot(eye.trocar_mm, self._scenario.robot, Pose(0.0, 0.0)).pitch_towards(eye.target_mm)
        self._steered = _Steered(person, self._scenario, aim_deg, self._limit_s)
        self._phantom = Phantom(self._scenario, self._steered)

    def read(self, timeout_s: float) -> Capture | None:
        moment = self._phantom.advance(draws=self._draws)
        if moment is None:
            raise EndOfSource
        self._index += 1
        stamp_ns = round(self._index * 1e9 / self.rate_hz)
        hand = self._steered.teleop.hand
        return Capture(self._index, stamp_ns, moment.image, truth=moment.truth, hand=hand)

    def close(self) -> None:
        pass


class _Skin:
    """A device that a simulated person feels; it does whatever it is told."""

    capabilities = Capabilities(amplitude_levels=65535, frequency_range_hz=(0.0, 1000.0), shortest_on_ms=0.0)

    def __init__(self, person: SimulatedPerson, felt: list[tuple[int, float]]) -> None:
        self._person, self._felt = person, felt

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        self._felt.append((stamp_ns, amplitude))
        self._person.feel(stamp_ns, amplitude, frequency_hz)

    def close(self) -> None:
        pass
