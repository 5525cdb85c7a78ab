"""The motion of one instrument in a recording, as images, robot and hand recorded it."""

import math

import numpy as np
from msgspec import Struct

from haptigraph.analysis.robot.lag import Lag, Motion
from haptigraph.errors import BadInput
from haptigraph.geometry import Circle, Point, Segment, subtract, unit
from haptigraph.messages import Capture, Step
from haptigraph.recording.reader import RunReader
from haptigraph.robot.pose import Floats, at_times

__all__ = ["RecordedMotion", "recorded_hand", "recorded_motion"]

NS_PER_S = 1e9
NO_TIP = "has no image in which a needle's tip is seen inside the eye"


class RecordedMotion(Struct, frozen=True):
    """What images and robot say of one instrument."""

    motion: Motion
    """Times from the first image on."""
    image_sd_mm: Floats
    """Standard deviation of the tips in the images, (n,)."""
    start_ns: int
    """Stamp of the first image."""
    target_mm: Floats
    """Where the target is, eye frame, (3,)."""

    def robot_at_images(self, lag: Lag) -> tuple[Floats, Floats]:
        """Return the robot's tips at the images, and which images they cover, (n, 3) and (n,)."""
        motion = self.motion
        at_s = motion.image_s + lag.lag_s + lag.drift_s_per_s * (motion.image_s - lag.middle_s)
        inside: Floats = (at_s >= motion.robot_s[0]) & (at_s <= motion.robot_s[-1])
        return at_times(motion.robot_s, motion.robot_mm, at_s), inside


def recorded_motion(reader: RunReader) -> RecordedMotion:
    """Read the tips of a recording: those inside the eye whose standard deviation is known.

    Raises:
        BadInput: If there are no robot samples, or no images with a tip.
    """
    image: list[tuple[float, float, float, float]] = []
    robot: list[tuple[float, ...]] = []
    start_ns, target_mm = None, (0.0, 0.0)
    for capture, step in reader.records(images=()):
        start_ns = capture.stamp_ns if start_ns is None else start_ns
        image += _tip(capture, step, start_ns)
        robot += [((one.stamp_ns - start_ns) / NS_PER_S, *one.position_mm) for one in capture.robot]
        if isinstance(target := step.observation.found.get("retina_target"), Point):
            target_mm = target.at_mm
    if start_ns is None or not robot:
        raise BadInput("has no robot measurements; record the run with --robot", reader.path)
    if not image:
        raise BadInput(NO_TIP, reader.path)
    seen, reported = np.array(image), np.array(sorted(robot))
    reported = reported[np.append(True, np.diff(reported[:, 0]) > 0)]
    return RecordedMotion(
        Motion(seen[:, 0], seen[:, 1:3], reported[:, 0], reported[:, 1:4]),
        seen[:, 3],
        start_ns,
        np.array([*target_mm, 0.0]),
    )


def recorded_hand(reader: RunReader) -> Motion:
    """Read the tips of a recording, as `recorded_motion`, and the path on which the operator's hand led them.

    The path is the sum of the hand's motions, scaled, along and across the shaft in each image.

    Raises:
        BadInput: If no hand is recorded, or there are no images with a tip.
    """
    image: list[tuple[float, float, float, float]] = []
    path: list[tuple[float, ...]] = []
    start_ns, at_mm, along = None, np.zeros(3), None
    for capture, step in reader.records(images=()):
        start_ns = capture.stamp_ns if start_ns is None else start_ns
        image += _tip(capture, step, start_ns)
        line, hand = step.observation.found.get("needle_line"), capture.hand
        if isinstance(line, Segment):
            along = unit(subtract(line.end_mm, line.start_mm))
        if hand is None or along is None:
            continue
        u, v = along
        moved_mm = hand.along_mm * np.array((u, v, 0.0)) + hand.across_mm * np.array((-v, u, 0.0))
        at_mm = at_mm + hand.motion_scale * moved_mm
        path.append(((capture.stamp_ns - start_ns) / NS_PER_S, *at_mm.tolist()))
    if not path:
        raise BadInput("has no motion of a hand that steers; record a run of `teleop`", reader.path)
    if not image:
        raise BadInput(NO_TIP, reader.path)
    seen, led = np.array(image), np.array(path)
    return Motion(seen[:, 0], seen[:, 1:3], led[:, 0], led[:, 1:4])


def _tip(capture: Capture, step: Step, start_ns: int) -> list[tuple[float, float, float, float]]:
    """Return time [s], tip and standard deviation of one image; nothing if its tip is not to be relied on."""
    tip, globe = (step.observation.found.get(name) for name in ("needle_tip", "eye_globe"))
    certainty = step.observation.certainty
    if not isinstance(tip, Point) or certainty is None or certainty.tip_sd_mm is None:
        return []
    if isinstance(globe, Circle) and math.dist(tip.at_mm, globe.center_mm) > globe.radius_mm:
        return []
    return [((capture.stamp_ns - start_ns) / NS_PER_S, *tip.at_mm, certainty.tip_sd_mm)]
