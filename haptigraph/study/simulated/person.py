"""A simulated operator in the loop: sees the picture late, feels the device later, moves the hand.

Turns what the screen shows and what the device does into motion of the hand. Control is intermittent (Craik
1947): pieces of minimum-jerk motion (Flash and Hogan 1985), each planned from what was seen and felt a
reaction time ago and what was moved since (Miall et al. 1993, J. Mot. Behav. 25: a Smith predictor). Told, as
in the study: vibration, stop and align; pulses, withdraw; double burst, done. Neither tires nor learns.
Knows no graph, no rule, no state and no command: only picture and device.
"""

import math
from bisect import bisect_right

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec, subtract
from haptigraph.sim.robot.operator import Tremor
from haptigraph.study.simulated.belief import ANGLES_DEG, Belief, seen_angle_deg
from haptigraph.study.simulated.participant import Participant
from haptigraph.study.simulated.touch_sense import NOTHING, TRAIN_S, Felt, SenseOfTouch

__all__ = ["Motion", "SimulatedPerson"]

RMS_OVER_MEAN = math.sqrt(10 / 7)  # speed of a minimum-jerk movement
TARGET_MM = 1.4  # width of the target: 0.7 mm to either side (paper, table I)
PAUSE_S = 0.1  # nothing seen yet, or nothing to do
TREMOR_HZ = (8.0, 12.0)
SLOWEST_S = 0.1


class Motion(Struct, frozen=True):
    """What a hand does in the time of one image."""

    along_mm: float
    """Motion of the tool that the hand is after, into the eye."""
    turn_deg: float
    """Turn of the shaft that the hand is after, counter-clockwise."""
    tremor_mm: Vec
    """Motion of the hand itself that it is not after, (along, across)."""


class _Piece(Struct):
    """One movement, from its start to its end."""

    start_s: float
    lasts_s: float
    along_mm: float
    turn_deg: float
    meant_deg: float
    """The turn without motor noise: what the mind knows of it."""
    meant_mm: float

    def done(self, time_s: float) -> float:
        """Return the share that is done."""
        share = min(max((time_s - self.start_s) / self.lasts_s, 0.0), 1.0)
        return share**3 * (10 - 15 * share + 6 * share**2)


def _still(start_s: float, lasts_s: float) -> _Piece:
    return _Piece(start_s, lasts_s, 0.0, 0.0, 0.0, 0.0)


class _Memory(Struct, frozen=True):
    """What was on the screen at one moment, and what had been meant to be moved by then."""

    depth_mm: float
    theta_deg: float
    meant_mm: float
    meant_deg: float


class SimulatedPerson:
    """One participant in one trial.

    Args:
        participant: Who.
        taught: What training taught: the amplitude that is felt at each of `ANGLES_DEG`.
        axis_mm: From the trocar to the target.
        seed: Of everything by chance; sight, touch and hand have their own, so that what is felt changes
            nothing of what is seen.
    """

    def __init__(
        self, participant: Participant, taught: NDArray[np.float64], axis_mm: float, seed: tuple[int, ...]
    ) -> None:
        self.participant = participant
        self._sight, self._touch, self._hand = (np.random.default_rng((*seed, part)) for part in range(3))
        self._taught = np.where(taught >= participant.faintest, taught, 0.0)
        self._axis_mm = axis_mm
        self._bias_deg = participant.misjudgement_deg * float(self._sight.standard_normal())
        self._belief = Belief(participant.misjudgement_deg)
        self._sense = SenseOfTouch(participant.faintest)
        self._tremor = Tremor(participant.tremor_mm, *TREMOR_HZ, int(self._hand.integers(2**31)))
        self._shaken_mm = self._tremor.at(0.0)
        self._times_s: list[float] = []
        self._memories: list[_Memory] = []
        self._meant_mm = self._meant_deg = 0.0
        self._believed_mm = self._believed_deg = 0.0
        self._depth_mm = 1.0
        self._piece = _still(0.0, PAUSE_S)
        self._felt = NOTHING
        self._calm_s = 0.0
        self._is_done = False

    def see(self, time_s: float, depth_mm: float, theta_deg: float) -> None:
        """Take what the screen will show of a moment, after its delay; theta is signed."""
        self._times_s.append(time_s)
        self._memories.append(_Memory(depth_mm, theta_deg, self._meant_mm, self._meant_deg))

    def feel(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Take what the device was told; felt after a delay."""
        self._sense.tell(stamp_ns / 1e9, amplitude)

    def act(self, time_s: float, elapsed_s: float) -> Motion:
        """Return what the hand does in the `elapsed_s` before a moment."""
        before_s = time_s - elapsed_s
        self._react(before_s)
        if before_s >= self._piece.start_s + self._piece.lasts_s - 1e-9:
            self._piece = self._plan(before_s)
        piece = self._piece
        share = piece.done(time_s) - piece.done(before_s)
        self._meant_mm += share * piece.meant_mm
        self._meant_deg += share * piece.meant_deg
        before_mm, self._shaken_mm = self._shaken_mm, self._tremor.at(time_s)
        return Motion(share * piece.along_mm, share * piece.turn_deg, subtract(self._shaken_mm, before_mm))

    def _react(self, time_s: float) -> None:
        """Break off a movement when something new is felt; draw back on an alarm."""
        before, self._felt = self._felt, self._sense.at(time_s - self.participant.feeling_s)
        if self._felt.word == before.word:
            return
        if self._felt.word == "alarm" and time_s >= self._calm_s:
            self._piece = self._withdrawal(time_s)
        elif self._felt.word != "nothing" and self._piece.along_mm > 0:
            self._piece = _still(time_s, SLOWEST_S)

    def _plan(self, time_s: float) -> _Piece:
        """Plan the next movement from what was seen and felt a reaction time ago."""
        who = self.participant
        glance, judged = self._sight.standard_normal(2)
        attention, strength = self._touch.uniform(), self._touch.standard_normal()
        noise = self._hand.standard_normal(3)
        seen = self._memory(time_s - who.sight_s)
        if seen is None or self._is_done:
            return _still(time_s, PAUSE_S)
        self._depth_mm = max(seen.depth_mm + self._meant_mm - seen.meant_mm, 1.0)
        self._catch_up()
        self._look(seen, float(glance))
        felt = self._felt if attention < who.notices_share else NOTHING
        if attention < who.notices_share:
            self._attend(felt, time_s - who.feeling_s, 1 + who.strength_share * float(strength))
        self._is_done = felt.word == "praise"
        if felt.word == "alarm" and time_s >= self._calm_s:
            return self._withdrawal(time_s)
        if felt.word in ("alarm", "strong", "praise"):
            return _still(time_s, PAUSE_S)
        theta_deg = self._belief.likeliest_deg()
        left_mm = self._axis_mm * math.cos(math.radians(theta_deg)) - self._depth_mm
        aligns = felt.word == "guidance"
        wish_mm = 0.0 if aligns else left_mm * (1 + who.distance_share * float(judged))
        return self._towards(time_s, wish_mm, -theta_deg, only_turns=aligns, noise=noise)

    def _withdrawal(self, time_s: float) -> _Piece:
        way_mm = self.participant.withdraw_mm
        lasts_s = self._fitts_s(way_mm)
        self._calm_s = time_s + lasts_s + self.participant.feeling_s + TRAIN_S
        return _Piece(time_s, lasts_s, -way_mm, 0.0, 0.0, -way_mm)

    def _catch_up(self) -> None:
        """Let the belief follow what was meant to be moved since the last plan."""
        who = self.participant
        turned_deg, moved_mm = self._meant_deg - self._believed_deg, self._meant_mm - self._believed_mm
        self._believed_deg, self._believed_mm = self._meant_deg, self._meant_mm
        astray = math.degrees(moved_mm / self._depth_mm) * math.tan(math.radians(who.direction_deg))
        self._belief.turned(turned_deg, math.hypot(who.motor_share * turned_deg, astray))

    def _look(self, seen: _Memory, glance: float) -> None:
        """Let what was seen count for the angle of now, by what was turned since."""
        who = self.participant
        turned_deg = self._meant_deg - seen.meant_deg
        angle_deg = seen_angle_deg(np.array(seen.theta_deg), seen.depth_mm, self._axis_mm)
        seen_deg = float(angle_deg) + self._bias_deg + who.glance_sd_deg * glance
        expected_deg = seen_angle_deg(ANGLES_DEG - turned_deg, seen.depth_mm, self._axis_mm)
        self._belief.look(seen_deg, expected_deg, who.glance_sd_deg)

    def _attend(self, felt: Felt, then_s: float, factor: float) -> None:
        """Let what was felt count for the angle of now; only guidance and silence tell of it."""
        then = self._memory(then_s)
        if then is None or felt.word not in ("guidance", "nothing"):
            return
        turned_deg = self._meant_deg - then.meant_deg
        expected = np.interp(ANGLES_DEG - turned_deg, ANGLES_DEG, self._taught)
        expected = np.where(expected >= self.participant.faintest, expected, 0.0)
        self._belief.feel(felt.share * factor, expected, self.participant.strength_share)

    def _towards(
        self, time_s: float, wish_mm: float, turn_deg: float, *, only_turns: bool, noise: NDArray[np.float64]
    ) -> _Piece:
        """Plan the first piece of the way: straight to the target, but for what is aligned at once."""
        who = self.participant
        sideways_mm = self._depth_mm * math.radians(turn_deg)
        needed_s = max(
            self._fitts_s(math.hypot(wish_mm, sideways_mm)),
            RMS_OVER_MEAN * abs(wish_mm) / who.pace_mm_s,
            RMS_OVER_MEAN * abs(turn_deg) / who.pace_deg_s,
        )
        lasts_s = min(needed_s, who.plan_s)
        share = lasts_s / needed_s
        along_mm = share * wish_mm
        most_deg = who.pace_deg_s * lasts_s / RMS_OVER_MEAN
        meant_deg = turn_deg * (share if only_turns else max(share, who.align_share))
        meant_deg = min(max(meant_deg, -most_deg), most_deg)
        size, turn_size, direction = noise
        astray_mm = along_mm * math.tan(math.radians(who.direction_deg * direction))
        astray_deg = math.degrees(astray_mm / self._depth_mm)
        return _Piece(
            start_s=time_s,
            lasts_s=lasts_s,
            along_mm=along_mm * (1 + who.motor_share * size),
            turn_deg=meant_deg * (1 + who.motor_share * turn_size) + astray_deg,
            meant_deg=meant_deg,
            meant_mm=along_mm,
        )

    def _memory(self, time_s: float) -> _Memory | None:
        """Return what was on the screen at a moment."""
        place = bisect_right(self._times_s, time_s + 1e-9)
        return self._memories[place - 1] if place else None

    def _fitts_s(self, distance_mm: float) -> float:
        """Return the time a movement takes at least (Fitts 1954, in Shannon's form)."""
        bits = math.log2(distance_mm / TARGET_MM + 1)
        return max(bits / self.participant.throughput_bit_s, SLOWEST_S)
