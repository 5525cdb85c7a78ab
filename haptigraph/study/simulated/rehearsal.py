"""One trial of a simulated participant: person, hand, robot, eye and the actual pipeline in a closed loop.

Yields the steps of a run and its haptic output for participant, condition and seed. Graph, rules, haptics,
guard and teleoperation are those of any run; perception runs on rendered images, or is the ground truth with
noise. A virtual clock makes the steps bit-identical for the same seed.
"""

import math
import warnings
from collections.abc import Generator, Sequence
from functools import lru_cache

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.clock import VirtualClock
from haptigraph.config import Config
from haptigraph.errors import BadInput, EndOfSource, RenamedKey
from haptigraph.geometry import Vec
from haptigraph.haptics.guard import Guard
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Capabilities, Capture, Step
from haptigraph.pipeline import Loop
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.sim.eye.eye import Eye, EyeShape
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.robot.operator import Move
from haptigraph.sim.robot.robot import Pose, Robot, RobotLimits
from haptigraph.sim.scenario import About, Scenario
from haptigraph.sources.jpeg import JpegSource
from haptigraph.stages import Sink, Source
from haptigraph.study.simulated.ground_truth import GROUND_TRUTH, GroundTruthPerceiver
from haptigraph.study.simulated.hand import PushedHand
from haptigraph.study.simulated.participant import Participant
from haptigraph.study.simulated.person import SimulatedPerson
from haptigraph.study.simulated.training import trained_amplitudes
from haptigraph.teleop.mapping import MIN_LEVER_MM
from haptigraph.teleop.motion import HandMotion, TeleopSettings
from haptigraph.teleop.teleop import Teleop

__all__ = ["FORCES", "NO_TOUCH", "SHIPPED", "Condition", "Rehearsal", "draw_scenario", "entry_scenario"]

START_MM = 3.0
LIMIT_S = 180.0
AFTER_NS = 1_500_000_000  # after the hit, for its pattern
HIT = "target_hit"


class Condition(Struct, frozen=True):
    """A haptic condition."""

    name: str
    procedure: str
    max_amplitude: float = 1.0
    """The guard's limit; 0: no haptic output."""
    text: str = ""
    """Text of the procedure, for machines that lack the file; empty: load it by its name."""
    has_force: bool = False
    """Whether the hand feels the forces of the procedure."""


NO_TOUCH = Condition("no touch", "subretinal_injection", 0.0)
SHIPPED = (
    NO_TOUCH,
    Condition("binary", "subretinal_injection"),
    Condition("continuous", "subretinal_injection_continuous"),
)
"""The paper's two conditions, and the one that it proposes."""
FORCES = (
    NO_TOUCH,
    Condition("vibration", "subretinal_injection"),
    Condition("force", "subretinal_injection_force", 0.0, has_force=True),
    Condition("both", "subretinal_injection_force", has_force=True),
)
"""The same vibration with and without forces, and forces alone."""


class Rehearsal:
    """One trial, from the needle's entry to the target.

    Args:
        participant: The participant.
        condition: The haptic condition.
        scenario: Eye, camera, robot and initial needle; see `draw_scenario`.
        seed: Of all noise of this trial; the same in every condition.
        perceiver: Name of a perceiver, which gets rendered images, or `GROUND_TRUTH`.
        config: All other settings of the run.
        limit_s: Time limit.
        sinks: Additional sinks of steps.

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
        perceiver: str = GROUND_TRUTH,
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
        with warnings.catch_warnings(action="ignore", category=RenamedKey):  # shown when it was loaded
            self.procedure = (
                _procedure(condition.text, condition.procedure)
                if condition.text
                else assemble.load_procedure(condition.procedure)
            )
            if HIT not in [state.name for state in self.procedure.states]:
                problem = f"has no state {HIT}; simulated participants can only hit a target"
                raise BadInput(problem, f"procedure {condition.procedure}")
            weakest = self.config.haptics.weakest_amplitude
            trained = trained_amplitudes(self.procedure.text, condition.max_amplitude, weakest)
        eye = Eye(scenario.eye)
        axis_mm = math.dist(eye.trocar_mm, eye.target_mm)
        is_rendered = perceiver != GROUND_TRUTH
        rate_hz = scenario.about.rate_hz
        self.person = SimulatedPerson(participant, trained, axis_mm, (*seed, 2), rate_hz)
        scale = scenario.robot.motion_scale
        self._hand = PushedHand(participant, scale) if condition.has_force else None
        steered = _Steered(self.person, self._hand, scenario, eye, limit_s)
        source = _SteeredSource(scenario, steered, is_rendered)
        self.registration = _registration(source.registration or "")
        truth = None if is_rendered else GroundTruthPerceiver(self.registration, (*seed, 1))
        quality = self.config.source.jpeg_quality
        images: Source = JpegSource(source, quality) if is_rendered and quality else source
        self.output: list[tuple[int, float]] = []
        """Every change of the device's output: (stamp_ns, amplitude)."""
        self.is_hit = False
        """Whether the target was hit."""
        self.steered_s = 0.0
        """Duration until now."""
        self.loop = Loop(
            assemble.build_pipeline(self.config, self.registration, self.procedure, truth),
            source=images,
            output=Guard(_FeltDevice(self.person, self.output), self.config.haptics),
            sinks=sinks,
            clock=VirtualClock(),
        )

    def steps(self) -> Generator[Step, None, None]:
        """Yield the steps until shortly after the target was hit, or until the time limit."""
        hit_ns: int | None = None
        for step in self.loop.steps():
            self.steered_s = step.stamp_ns / 1e9
            if self._hand is not None:
                self._hand.take(step)
            yield step
            if hit_ns is None and step.conclusion.state == HIT:
                hit_ns, self.is_hit = step.stamp_ns, True
            if hit_ns is not None and step.stamp_ns - hit_ns >= AFTER_NS:
                return

    def mean_force_n(self, start_ns: int, end_ns: int) -> float:
        """Return the mean size of the force on the hand over some time; 0 if it feels none."""
        return self._hand.mean_force_n(start_ns, end_ns) if self._hand is not None else 0.0


def draw_scenario(seed: tuple[int, ...], *, rate_hz: float = 30.0) -> Scenario:
    """Draw the positions of target and trocar; the needle has just entered, perpendicular to the wall.

    The distributions are those of `sim.scenes`. The initial misalignment follows from the positions.

    Args:
        seed: Of the positions.
        rate_hz: Images per second.
    """
    rng = np.random.default_rng((*seed, 0))
    side = float(rng.choice((-1, 1)))
    shape = EyeShape(target_deg=rng.uniform(-15, 15), trocar_deg=side * rng.uniform(28, 42))
    return entry_scenario(shape, int(rng.integers(2**31)), rate_hz=rate_hz)


def entry_scenario(shape: EyeShape, seed: int, *, rate_hz: float = 30.0) -> Scenario:
    """Return a scenario in which the needle has just entered, perpendicular to the wall."""
    eye, limits = Eye(shape), RobotLimits()
    aim_deg = Robot(eye.trocar_mm, limits, Pose(0.0, 0.0)).pitch_towards(eye.target_mm)
    about = About(description="A trial of a simulated participant.", seed=seed, rate_hz=rate_hz)
    return Scenario(about=about, moves=(Move(1.0, START_MM, -aim_deg),), eye=shape, robot=limits)


@lru_cache
def _procedure(text: str, name: str) -> Procedure:
    return assemble.parse_procedure(text, name)


@lru_cache
def _registration(text: str) -> Registration:
    return parse_camera_registration(text, "the simulated eye")


class _Steered:
    """The person as the operator of the phantom, through teleoperation, with a hand that forces may push."""

    def __init__(
        self, person: SimulatedPerson, hand: PushedHand | None, scenario: Scenario, eye: Eye, limit_s: float
    ) -> None:
        self.duration_s = limit_s
        self._person, self._hand = person, hand
        self._aim_deg = Robot(eye.trocar_mm, scenario.robot, Pose(0.0, 0.0)).pitch_towards(eye.target_mm)
        self._scale = scenario.robot.motion_scale
        settings = TeleopSettings(motion_scale=self._scale)
        self.teleop = Teleop(scenario.about.rate_hz, settings, scenario.about.seed)

    def move(self, robot: Robot, time_s: float, elapsed_s: float) -> None:
        motion = self._person.move(time_s, elapsed_s)
        depth_mm = robot.pose.depth_mm
        lever_mm = max(depth_mm**2, MIN_LEVER_MM**2) / depth_mm
        along_mm, across_mm = motion.along_mm, lever_mm * math.radians(motion.turn_deg)
        tremor_along_mm, tremor_across_mm = motion.tremor_mm
        hand_mm = along_mm / self._scale + tremor_along_mm, across_mm / self._scale + tremor_across_mm
        if self._hand is not None:
            hand_mm = _moved(self._hand, hand_mm, robot.direction(), elapsed_s)
        self.teleop.put(HandMotion(True, *hand_mm))
        self.teleop.move(robot, time_s, elapsed_s)
        self._person.add_screen(time_s, robot.pose.depth_mm, robot.pose.pitch_deg - self._aim_deg)

    def is_away(self, time_s: float) -> bool:
        return False


def _moved(hand: PushedHand, intended_mm: Vec, shaft: Vec, elapsed_s: float) -> Vec:
    """Return the motion of a hand along and across the shaft, pushed by forces in the eye frame."""
    along, across = intended_mm
    (x, y), (u, v) = shaft, (-shaft[1], shaft[0])
    x_mm, y_mm = hand.move((along * x + across * u, along * y + across * v), elapsed_s)
    return x_mm * x + y_mm * y, x_mm * u + y_mm * v


class _SteeredSource(Source):
    """Images of the phantom, rendered or not, while the person steers."""

    is_live = False

    def __init__(self, scenario: Scenario, steered: _Steered, is_rendered: bool) -> None:
        self._steered = steered
        self._phantom = Phantom(scenario, self._steered)
        self._is_rendered = is_rendered
        self.rate_hz = scenario.about.rate_hz
        self.registration: str | None = self._phantom.registration
        self._index = -1

    def read(self, timeout_s: float) -> Capture | None:
        moment = self._phantom.advance(draws=self._is_rendered)
        if moment is None:
            raise EndOfSource
        self._index += 1
        stamp_ns = round(self._index * 1e9 / self.rate_hz)
        hand = self._steered.teleop.hand
        return Capture(self._index, stamp_ns, moment.image, truth=moment.truth, hand=hand)

    def close(self) -> None:
        pass


class _FeltDevice:
    """An ideal device whose output a simulated person feels."""

    capabilities = Capabilities(amplitude_levels=65535, frequency_range_hz=(0.0, 1000.0), shortest_on_ms=0.0)

    def __init__(self, person: SimulatedPerson, output: list[tuple[int, float]]) -> None:
        self._person, self._output = person, output

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        self._output.append((stamp_ns, amplitude))
        self._person.add_output(stamp_ns, amplitude, frequency_hz)

    def close(self) -> None:
        pass
