"""What a CRTK arm that is moved by hand sends, sound or sabotaged, as a list in order of arrival."""

from dataclasses import dataclass, replace
from functools import cache

import arm_motion
import numpy as np

START_NS = 1_790_000_000_000_000_000
BASE = "PSM1_base"
SABOTAGES = {}


@dataclass(frozen=True)
class Sent:
    """One message; `numbers` are position and quaternion, twist, or joints."""

    topic: str
    stamp_ns: int
    arrival_ns: int
    numbers: tuple = ()
    frame_id: str = BASE
    sender: int = 1
    state: str = "ENABLED"
    is_homed: bool = True


@cache
def sound(seed, seconds=8.0, rate_hz=100.0, latency_ms=(20.0, 5.0)):
    """Messages of a sound interface: joint noise 0.02 deg, latency 20 +- 5 ms, in order."""
    rng = np.random.default_rng(seed)
    sent, last_ns = [], 0
    shift_s = rng.uniform(0, 10)

    def joints_at(time_s):
        return arm_motion.by_hand(time_s + shift_s)

    for number in range(int(seconds * rate_hz)):
        time_s = number / rate_hz
        stamp_ns = START_NS + int(1e9 * time_s)
        last_ns = max(last_ns + 1, stamp_ns + int(1e6 * max(rng.normal(*latency_ms), 0.1)))
        joints = arm_motion.noisy(joints_at(time_s), rng)
        tip_m, rotation = arm_motion.forward(joints)
        velocity = arm_motion.twist(joints_at, time_s) * rng.normal(1, 0.02, 6)
        numbers = (*tip_m.tolist(), *arm_motion.quaternion(rotation).tolist())
        sent.append(Sent("measured_cp", stamp_ns, last_ns, numbers))
        sent.append(Sent("measured_cv", stamp_ns, last_ns, tuple(velocity.tolist())))
        sent.append(Sent("measured_js", stamp_ns, last_ns, tuple(joints.tolist())))
        if number % 10 == 0:
            sent.append(Sent("operating_state", stamp_ns, last_ns))
    return tuple(sent)


def sabotaged(name, seed):
    """Messages of an interface with one sabotage."""
    return SABOTAGES[name][1](sound(seed), np.random.default_rng(seed + 1))


def sabotage(finding):
    """Register a function from sound messages to sabotaged ones, with the name of the finding it must cause."""

    def register(function):
        SABOTAGES[function.__name__] = finding, function
        return function

    return register


def on(topic, sent, change):
    """Change the messages of a topic."""
    return [change(one) if one.topic == topic else one for one in sent]


def scaled(one, first, last, factor):
    numbers = list(one.numbers)
    numbers[first:last] = [factor * number for number in numbers[first:last]]
    return replace(one, numbers=tuple(numbers))


def by_arrival(sent):
    return sorted(sent, key=lambda one: one.arrival_ns)


@sabotage("units")
def millimetres_for_metres(sent, rng):
    return on("measured_cp", sent, lambda one: scaled(one, 0, 3, 1e3))


@sabotage("velocity_units")
def millimetres_per_second(sent, rng):
    return on("measured_cv", sent, lambda one: scaled(one, 0, 3, 1e3))


@sabotage("joint_units")
def degrees_in_joints(sent, rng):
    return on("measured_js", sent, lambda one: scaled(one, 0, 3, 180 / np.pi))


@sabotage("velocity_units")
def degrees_per_second(sent, rng):
    return on("measured_cv", sent, lambda one: scaled(one, 3, 6, 180 / np.pi))


@sabotage("left_handed")
def left_handed_frame(sent, rng):
    return on("measured_cp", sent, lambda one: scaled(one, 2, 3, -1.0))


@sabotage("axes_exchanged")
def exchanged_axes(sent, rng):
    def turn(one):
        x, y, z, *rest = one.numbers
        return replace(one, numbers=(y, -x, z, *rest))

    return on("measured_cp", sent, turn)


@sabotage("quaternion_order")
def quaternion_w_first(sent, rng):
    def reorder(one):
        x, y, z, w = one.numbers[3:]
        return replace(one, numbers=(*one.numbers[:3], w, x, y, z))

    return on("measured_cp", sent, reorder)


@sabotage("quaternion_inverse")
def orientation_of_the_base(sent, rng):
    return on("measured_cp", sent, lambda one: scaled(one, 3, 6, -1.0))


@sabotage("quaternion_length")
def quaternion_not_normalised(sent, rng):
    return on("measured_cp", sent, lambda one: scaled(one, 3, 7, 1.05))


@sabotage("frames_differ")
def swapped_frame_ids(sent, rng):
    changed = on("measured_cp", sent, lambda one: replace(one, frame_id="PSM1_tool"))
    return on("measured_cv", changed, lambda one: replace(one, frame_id=BASE))


@sabotage("frame_changes")
def alternating_frame_ids(sent, rng):
    frames = {0: BASE, 1: "PSM1_tool"}
    return on("measured_cp", sent, lambda one: replace(one, frame_id=frames[int(rng.integers(2))]))


@sabotage("frame_missing")
def no_frame_id(sent, rng):
    return on("measured_cp", sent, lambda one: replace(one, frame_id=""))


@sabotage("velocity_frame")
def velocity_in_the_tool(sent, rng):
    poses = {one.stamp_ns: one.numbers for one in sent if one.topic == "measured_cp"}

    def turn(one):
        x, y, z, w = poses[one.stamp_ns][3:]
        axis = np.array([x, y, z])

        def back(vector):  # rotation by the conjugate
            twice = 2 * np.cross(-axis, vector)
            return vector + w * twice + np.cross(-axis, twice)

        velocity = np.array(one.numbers)
        return replace(one, numbers=(*back(velocity[:3]).tolist(), *back(velocity[3:]).tolist()))

    return on("measured_cv", sent, turn)


@sabotage("velocity_inconsistent")
def velocity_of_something_else(sent, rng):
    def other(one):
        time_s = (one.stamp_ns - START_NS) / 1e9
        return replace(one, numbers=tuple(0.02 * np.sin(np.arange(6) + 5 * time_s)))

    return on("measured_cv", sent, other)


@sabotage("rate")
def five_per_second(sent, rng):
    kept = {one.stamp_ns for one in sent if one.topic == "measured_cp"}
    kept = set(sorted(kept)[::20])
    return [one for one in sent if one.topic == "operating_state" or one.stamp_ns in kept]


@sabotage("bursts")
def bursts(sent, rng):
    """All messages of 100 ms at once."""
    period_ns = 100_000_000
    late = [replace(one, arrival_ns=-(-one.arrival_ns // period_ns) * period_ns) for one in sent]
    return [replace(one, arrival_ns=one.arrival_ns + 1000 * number) for number, one in enumerate(late)]


@sabotage("latency")
def latency_of_300_ms(sent, rng):
    return [replace(one, arrival_ns=one.arrival_ns + 280_000_000) for one in sent]


@sabotage("stamps_frozen")
def frozen_stamps(sent, rng):
    return [replace(one, stamp_ns=START_NS) for one in sent]


@sabotage("stamps_missing")
def no_stamps(sent, rng):
    return [replace(one, stamp_ns=0) for one in sent]


@sabotage("stamps_future")
def stamps_in_the_future(sent, rng):
    return [replace(one, stamp_ns=one.stamp_ns + 60_000_000) for one in sent]


@sabotage("stamps_past")
def stamps_hours_off(sent, rng):
    return [replace(one, stamp_ns=one.stamp_ns - 7_200_000_000_000) for one in sent]


@sabotage("stamps_backwards")
def stamps_out_of_order(sent, rng):
    return [replace(one, stamp_ns=one.stamp_ns - int(rng.integers(0, 60_000_000))) for one in sent]


@sabotage("pose_frozen")
def frozen_pose(sent, rng):
    """Stamps advance; the pose stays after 3 s."""
    stuck = next(one for one in sent if one.topic == "measured_cp" and one.stamp_ns > START_NS + 3e9)

    def freeze(one):
        return replace(one, numbers=stuck.numbers) if one.stamp_ns > stuck.stamp_ns else one

    return on("measured_cp", sent, freeze)


@sabotage("not_moved")
def standing_still(sent, rng):
    first = {
        topic: next(one for one in sent if one.topic == topic) for topic in ("measured_cp", "measured_js")
    }

    def stay(one):
        return replace(one, numbers=tuple(np.add(first[one.topic].numbers, rng.normal(0, 1e-5))))

    at_rest = on("measured_js", on("measured_cp", sent, stay), stay)
    return on("measured_cv", at_rest, lambda one: scaled(one, 0, 6, 1e-6))


@sabotage("not_finite")
def nan_now_and_then(sent, rng):
    def damage(one):
        is_bad = rng.random() < 0.02
        return replace(one, numbers=(float("nan"), *one.numbers[1:])) if is_bad else one

    return on("measured_cp", sent, damage)


@sabotage("state_missing")
def no_state(sent, rng):
    return [one for one in sent if one.topic != "operating_state"]


@sabotage("state_flapping")
def flapping_state(sent, rng):
    states = ("ENABLED", "PAUSED")
    return on("operating_state", sent, lambda one: replace(one, state=states[int(rng.integers(2))]))


@sabotage("state_unknown")
def another_state(sent, rng):
    return on("operating_state", sent, lambda one: replace(one, state="READY"))


@sabotage("state_fault")
def fault(sent, rng):
    return on("operating_state", sent, lambda one: replace(one, state="FAULT"))


@sabotage("not_homed")
def not_homed(sent, rng):
    return on("operating_state", sent, lambda one: replace(one, is_homed=False))


@sabotage("two_publishers")
def two_publishers(sent, rng):
    """A second node with the same name, whose arm stands elsewhere."""
    poses = [one for one in sent if one.topic == "measured_cp"]
    other = [
        replace(scaled(one, 0, 1, 1.5), sender=2, arrival_ns=one.arrival_ns + 3_000_000) for one in poses
    ]
    return by_arrival([*sent, *other])


@sabotage("axis_opposite")
def opposite_tool_axis(sent, rng):
    """The tool's z axis points from tip to handle."""

    def turn(one):
        x, y, z, w = one.numbers[3:]
        return replace(one, numbers=(*one.numbers[:3], w, z, -y, -x))  # half a turn about the tool's x axis

    return on("measured_cp", sent, turn)


@sabotage("rcm_far")
def a_metre_from_the_rcm(sent, rng):
    def away(one):
        x, *rest = one.numbers
        return replace(one, numbers=(x + 1.0, *rest))

    return on("measured_cp", sent, away)
