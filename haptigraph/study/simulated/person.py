"""A simulated operator in the loop: perceives screen and device with delays, and moves the hand.

Control is intermittent (Craik 1947): minimum-jerk submovements (Flash and Hogan 1985), each planned from what
was perceived one latency ago and what was moved since, like a Smith predictor (Miall et al. 1993, J. Mot.
Behav. 25). Instructed as in the study: on vibration, stop and align; on pulses, withdraw; on a double burst,
finish. Neither tires nor learns. Its only inputs are screen and device, no graph, state or command.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from haptigraph.geometry import Vec, subtract
from haptigraph.sim.robot.operator import Tremor
from haptigraph.study.simulated.haptic_perception import NO_PERCEPT, TRAIN_S, HapticPerception, Percept
from haptigraph.study.simulated.participant import Participant
from haptigraph.study.simulated.posterior import ANGLES_DEG, AnglePosterior, FloatArray, visual_angle_deg

__all__ = ["Motion", "SimulatedPerson"]

RMS_OVER_MEAN = math.sqrt(10 / 7)  # speed of a minimum-jerk movement
TARGET_WIDTH_MM = 1.4  # 0.7 mm to either side (paper, table I)
PAUSE_S = 0.1  # before the first image, or with nothing to do
TREMOR_HZ = (8.0, 12.0)
MIN_DURATION_S = 0.1


class Motion(Struct, frozen=True):
    """Motion of the hand during one image."""

    along_mm: float
    """Intended motion of the tool into the eye."""
    turn_deg: float
    """Intended turn of the shaft, counter-clockwise."""
    tremor_mm: Vec
    """Unintended motion of the hand, (along, across)."""


class _Submovement(Struct):
    start_s: float
    duration_s: float
    along_mm: float
    turn_deg: float
    intended_deg: float
    """The turn without motor noise, as the operator's forward model predicts it."""
    intended_mm: float

    def progress(self, time_s: float) -> float:
        """Return the completed share."""
        share = min(max((time_s - self.start_s) / self.duration_s, 0.0), 1.0)
        return share**3 * (10 - 15 * share + 6 * share**2)


def _rest(start_s: float, duration_s: float) -> _Submovement:
    return _Submovement(start_s, duration_s, 0.0, 0.0, 0.0, 0.0)


class _ScreenSample(Struct, frozen=True):
    """What was displayed at one moment, and the sum of intended motion until then."""

    depth_mm: float
    theta_deg: float
    intended_mm: float
    intended_deg: float


class SimulatedPerson:
    """One participant in one trial.

    Args:
        participant: The participant.
        trained: The trained haptic amplitude at each of `ANGLES_DEG`.
        axis_mm: From the trocar to the target.
        seed: Of all noise. Vision, haptics and hand have generators of their own, so that haptic output does
            not change the visual noise.
        rate_hz: Images per second.
    """

    def __init__(
        self,
        participant: Participant,
        trained: FloatArray,
        axis_mm: float,
        seed: tuple[int, ...],
        rate_hz: float = 30.0,
    ) -> None:
        self.participant = participant
        self._vision, self._haptics, self._hand = (np.random.default_rng((*seed, part)) for part in range(3))
        self._trained = np.where(trained >= participant.absolute_threshold, trained, 0.0)
        self._axis_mm = axis_mm
        self._bias_deg = participant.visual_bias_sd_deg * float(self._vision.standard_normal())
        self._posterior = AnglePosterior(participant.visual_bias_sd_deg)
        self._perception = HapticPerception(participant.absolute_threshold)
        tremor = Tremor(participant.tremor_mm, *TREMOR_HZ, int(self._hand.integers(2**31)))
        self._tremor = tremor.at_images(rate_hz)
        self._tremor_mm = next(self._tremor)
        self._times_s: list[float] = []
        self._samples: list[_ScreenSample] = []
        self._intended_mm = self._intended_deg = 0.0
        self._predicted_mm = self._predicted_deg = 0.0
        self._depth_mm = 1.0
        self._submovement = _rest(0.0, PAUSE_S)
        self._percept = NO_PERCEPT
        self._alarm_ignored_until_s = 0.0
        self._is_done = False

    def add_screen(self, time_s: float, depth_mm: float, theta_deg: float) -> None:
        """Add the needle that is displayed after the display delay; theta is signed."""
        self._times_s.append(time_s)
        self._samples.append(_ScreenSample(depth_mm, theta_deg, self._intended_mm, self._intended_deg))

    def add_output(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Add a change of the device's output, which is felt after the haptic latency."""
        self._perception.add(stamp_ns / 1e9, amplitude)

    def move(self, time_s: float, elapsed_s: float) -> Motion:
        """Return the motion of the hand in the `elapsed_s` before the moment of the next image."""
        before_s = time_s - elapsed_s
        self._react(before_s)
        if before_s >= self._submovement.start_s + self._submovement.duration_s - 1e-9:
            self._submovement = self._plan(before_s)
        current = self._submovement
        share = current.progress(time_s) - current.progress(before_s)
        self._intended_mm += share * current.intended_mm
        self._intended_deg += share * current.intended_deg
        before_mm, self._tremor_mm = self._tremor_mm, next(self._tremor)
        return Motion(
            share * current.along_mm, share * current.turn_deg, subtract(self._tremor_mm, before_mm)
        )

    def _react(self, time_s: float) -> None:
        """Interrupt a submovement on a new percept; withdraw on an alarm."""
        before, self._percept = self._percept, self._perception.at(time_s - self.participant.haptic_latency_s)
        if self._percept.cue == before.cue:
            return
        if self._percept.cue == "alarm" and time_s >= self._alarm_ignored_until_s:
            self._submovement = self._withdrawal(time_s)
        elif self._percept.cue != "none" and self._submovement.along_mm > 0:
            self._submovement = _rest(time_s, MIN_DURATION_S)

    def _plan(self, time_s: float) -> _Submovement:
        """Plan the next submovement from what was perceived one latency ago."""
        traits = self.participant
        angle_noise, distance_noise = self._vision.standard_normal(2).tolist()
        attention, amplitude_noise = self._haptics.uniform(), self._haptics.standard_normal()
        motor_noise = self._hand.standard_normal(3).tolist()
        seen = self._sample(time_s - traits.visual_latency_s)
        if seen is None or self._is_done:
            return _rest(time_s, PAUSE_S)
        self._depth_mm = max(seen.depth_mm + self._intended_mm - seen.intended_mm, 1.0)
        self._predict()
        self._add_visual_cue(seen, angle_noise)
        percept = self._percept if attention < traits.attention_probability else NO_PERCEPT
        if attention < traits.attention_probability:
            factor = 1 + traits.weber_fraction * amplitude_noise
            self._add_haptic_cue(percept, time_s - traits.haptic_latency_s, factor)
        self._is_done = percept.cue == "success"
        if percept.cue == "alarm" and time_s >= self._alarm_ignored_until_s:
            return self._withdrawal(time_s)
        if percept.cue in ("alarm", "strong", "success"):
            return _rest(time_s, PAUSE_S)
        theta_deg = self._posterior.most_probable_deg()
        remaining_mm = self._axis_mm * math.cos(math.radians(theta_deg)) - self._depth_mm
        remaining_mm *= 1 + traits.distance_sd_share * distance_noise
        only_turns = percept.cue == "guidance"
        advance_mm = 0.0 if only_turns else remaining_mm
        return self._towards(time_s, advance_mm, -theta_deg, only_turns=only_turns, noise=motor_noise)

    def _withdrawal(self, time_s: float) -> _Submovement:
        distance_mm = self.participant.withdraw_mm
        duration_s = self._fitts_s(distance_mm)
        self._alarm_ignored_until_s = time_s + duration_s + self.participant.haptic_latency_s + TRAIN_S
        return _Submovement(time_s, duration_s, -distance_mm, 0.0, 0.0, -distance_mm)

    def _predict(self) -> None:
        """Propagate the posterior by the intended motion since the last plan."""
        traits = self.participant
        turned_deg = self._intended_deg - self._predicted_deg
        moved_mm = self._intended_mm - self._predicted_mm
        self._predicted_deg, self._predicted_mm = self._intended_deg, self._intended_mm
        drift = math.degrees(moved_mm / self._depth_mm) * math.tan(math.radians(traits.direction_sd_deg))
        self._posterior.predict(turned_deg, math.hypot(traits.motor_sd_share * turned_deg, drift))

    def _add_visual_cue(self, seen: _ScreenSample, noise: float) -> None:
        """Update the posterior of the current angle, corrected for the turn since the image."""
        sd_deg = self.participant.glance_sd_deg
        turned_deg = self._intended_deg - seen.intended_deg
        angle_deg = visual_angle_deg(np.array(seen.theta_deg), seen.depth_mm, self._axis_mm)
        seen_deg = float(angle_deg) + self._bias_deg + sd_deg * noise
        expected_deg = visual_angle_deg(ANGLES_DEG - turned_deg, seen.depth_mm, self._axis_mm)
        self._posterior.add_visual_cue(seen_deg, expected_deg, sd_deg)

    def _add_haptic_cue(self, percept: Percept, felt_at_s: float, factor: float) -> None:
        """Update the posterior of the current angle; only guidance and silence are informative."""
        then = self._sample(felt_at_s)
        if then is None or percept.cue not in ("guidance", "none"):
            return
        turned_deg = self._intended_deg - then.intended_deg
        expected = np.interp(ANGLES_DEG - turned_deg, ANGLES_DEG, self._trained)
        expected = np.where(expected >= self.participant.absolute_threshold, expected, 0.0)
        weber_fraction = self.participant.weber_fraction
        self._posterior.add_haptic_cue(percept.amplitude * factor, expected, weber_fraction)

    def _towards(
        self, time_s: float, advance_mm: float, turn_deg: float, *, only_turns: bool, noise: Sequence[float]
    ) -> _Submovement:
        """Plan the first submovement of a straight path to the target, plus the immediate alignment."""
        traits = self.participant
        sideways_mm = self._depth_mm * math.radians(turn_deg)
        needed_s = max(
            self._fitts_s(math.hypot(advance_mm, sideways_mm)),
            RMS_OVER_MEAN * abs(advance_mm) / traits.pace_mm_s,
            RMS_OVER_MEAN * abs(turn_deg) / traits.pace_deg_s,
        )
        duration_s = min(needed_s, traits.plan_s)
        share = duration_s / needed_s
        along_mm = share * advance_mm
        max_deg = traits.pace_deg_s * duration_s / RMS_OVER_MEAN
        intended_deg = turn_deg * (share if only_turns else max(share, traits.align_share))
        intended_deg = min(max(intended_deg, -max_deg), max_deg)
        size, turn_size, direction = noise
        drift_mm = along_mm * math.tan(math.radians(traits.direction_sd_deg * direction))
        drift_deg = math.degrees(drift_mm / self._depth_mm)
        return _Submovement(
            start_s=time_s,
            duration_s=duration_s,
            along_mm=along_mm * (1 + traits.motor_sd_share * size),
            turn_deg=intended_deg * (1 + traits.motor_sd_share * turn_size) + drift_deg,
            intended_deg=intended_deg,
            intended_mm=along_mm,
        )

    def _sample(self, time_s: float) -> _ScreenSample | None:
        """Return what was displayed at a moment."""
        index = bisect_right(self._times_s, time_s + 1e-9)
        return self._samples[index - 1] if index else None

    def _fitts_s(self, distance_mm: float) -> float:
        """Return the minimum movement time (Fitts 1954, in Shannon's form)."""
        bits = math.log2(distance_mm / TARGET_WIDTH_MM + 1)
        return max(bits / self.participant.throughput_bit_s, MIN_DURATION_S)
