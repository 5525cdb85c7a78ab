"""Move a capture in time, with everything in it that is stamped on the same clock."""

from typing import TypeVar

from msgspec.structs import replace

from haptigraph.messages import Capture, ForceSample, RobotSample

__all__ = ["moved_in_time"]

Sample = TypeVar("Sample", RobotSample, ForceSample)


def moved_in_time(capture: Capture, by_ns: int) -> Capture:
    """Return a capture whose stamp, and those of its robot and force samples, are later by `by_ns`."""
    moved = replace(capture, stamp_ns=capture.stamp_ns + by_ns)
    if capture.robot:
        moved = replace(moved, robot=tuple(_moved(sample, by_ns) for sample in capture.robot))
    if capture.force:
        moved = replace(moved, force=tuple(_moved(sample, by_ns) for sample in capture.force))
    return moved


def _moved(sample: Sample, by_ns: int) -> Sample:
    return replace(sample, stamp_ns=sample.stamp_ns + by_ns)
