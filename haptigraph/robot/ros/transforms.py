"""The pose of one frame in another, from the transforms of /tf and /tf_static."""

import threading
from typing import NamedTuple

from haptigraph.robot.pose import IDENTITY, ToolPose, Transform
from haptigraph.robot.ros.poses import tool_pose
from haptigraph.ros2.geometry_types import TFMessage, TransformStamped

__all__ = ["FramePose", "TransformTree"]

MAX_LINKS = 100


class _Link(NamedTuple):
    parent: str
    transform: Transform
    stamp_ns: int | None
    """None: it never changes."""
    sender: int


class FramePose(NamedTuple):
    """The pose of a frame."""

    pose: ToolPose
    stamp_ns: int
    """Of the oldest transform that it consists of; 0: none of them moves."""
    senders: tuple[int, ...]
    """Who sent the transforms."""


class TransformTree:
    """The newest transform of every frame in its parent. May be used by several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._links: dict[str, _Link] = {}

    def put(self, message: TFMessage, sender: int, *, is_static: bool) -> None:
        """Take the transforms of a message.

        Raises:
            ValueError: If one is not valid; the others are taken.
        """
        problem: ValueError | None = None
        for stamped in message.transforms:
            try:
                self._put_one(stamped, sender, is_static=is_static)
            except ValueError as error:
                problem = error
        if problem is not None:
            raise problem

    def pose(self, base: str, tool: str) -> FramePose | None:
        """Return the pose of a frame in one above it; None while transforms are missing."""
        links: list[_Link] = []
        found, frame = IDENTITY, tool
        with self._lock:
            while frame != base:
                link = self._links.get(frame)
                if link is None or len(links) == MAX_LINKS:
                    return None
                links.append(link)
                frame, found = link.parent, link.transform @ found
        stamps_ns = [link.stamp_ns for link in links if link.stamp_ns is not None]
        return FramePose(found.as_pose(), min(stamps_ns, default=0), tuple(link.sender for link in links))

    def _put_one(self, stamped: TransformStamped, sender: int, *, is_static: bool) -> None:
        parent, child = (name.removeprefix("/") for name in (stamped.header.frame_id, stamped.child_frame_id))
        try:
            pose = tool_pose(stamped.transform.translation, stamped.transform.rotation)
        except ValueError as error:
            raise ValueError(f"the transform of {child}: {error}") from None
        stamp_ns = None if is_static else stamped.header.stamp.ns
        with self._lock:
            self._links[child] = _Link(parent, Transform.of(pose), stamp_ns, sender)
