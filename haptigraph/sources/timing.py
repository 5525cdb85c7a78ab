"""Move a capture in time, with everything in it that is stamped on the same clock."""

from msgspec.structs import replace

from haptigraph.messages import Capture

__all__ = ["moved_in_time"]


def moved_in_time(capture: Capture, by_ns: int) -> Capture:
    """Return a capture whose stamp, and those of its robot samples, are later by `by_ns`."""
    if not capture.robot:
        return replace(capture, stamp_ns=capture.stamp_ns + by_ns)
    robot = tuple(replace(sample, stamp_ns=sample.stamp_ns + by_ns) for sample in capture.robot)
    return replace(capture, stamp_ns=capture.stamp_ns + by_ns, robot=robot)
