"""sensor_msgs/Joy of a ROS 2 network as a leader, with the axes and buttons of joy_node (see `sticks`)."""

from collections import deque
from collections.abc import Callable, Sequence

from haptigraph.clock import Clock
from haptigraph.ros2.node import Node, checked_topic
from haptigraph.ros2.topics import topics_found
from haptigraph.ros2.types import Joy
from haptigraph.teleop.leaders.silence import Silence
from haptigraph.teleop.leaders.sticks import DEAD_ZONE, StickTimer, stick_motion
from haptigraph.teleop.motion import HandMotion

__all__ = ["DEFAULT_TOPIC", "JoyLeader", "JoySteering"]

DEFAULT_TOPIC = "/joy"
ACROSS, ALONG = 0, 1
"""Axes; ROS defines left and forward as positive (https://index.ros.org/p/joy)."""
OUTWARDS = 4
"""Axis of the right stick, forward and back; where there is none, no motion out of the picture."""
CLUTCH = 5
"""Button: the right shoulder in the usual order of joy_node."""
SILENCE_MS = 200.0
"""The leader is lost after this time without a message; joy_node sends at least 20 per second."""
MAX_WAITING = 256


class JoySteering:
    """Integrate stick deflections to hand motion.

    Args:
        put: Receives the motion.
        clock: Measures how long a stick was held.
    """

    def __init__(self, put: Callable[[HandMotion], None], clock: Clock) -> None:
        self._put, self._clock = put, clock
        self._timer = StickTimer(clock.now_ns())
        self._has_rested = False

    def take(self, message: Joy) -> None:
        """Process one message.

        Raises:
            ValueError: If it lacks an axis or button, or has a non-finite axis; the clutch is then released.
        """
        elapsed_s = self._timer.elapsed_s(self._clock.now_ns())
        try:
            motion = self._motion(message, elapsed_s)
        except ValueError:
            self._put(HandMotion(engaged=False))
            raise
        self._put(motion)

    def _motion(self, message: Joy, elapsed_s: float) -> HandMotion:
        axes, buttons = message.axes, message.buttons
        if len(axes) <= max(ACROSS, ALONG) or len(buttons) <= CLUTCH:
            raise ValueError(
                f"joy has {len(axes)} axes and {len(buttons)} buttons; axes {ACROSS} and {ALONG} and button "
                f"{CLUTCH} are used"
            )
        towards = -axes[OUTWARDS] if len(axes) > OUTWARDS else 0.0
        self._has_rested |= abs(towards) < DEAD_ZONE  # some pads have a trigger there, which rests at 1
        motion = stick_motion(elapsed_s, back=-axes[ALONG], right=-axes[ACROSS], towards=towards)
        if not buttons[CLUTCH]:
            return HandMotion(engaged=False)
        return motion if self._has_rested else HandMotion(True, motion.along_mm, motion.across_mm)


class JoyLeader:
    """Subscribe to a joystick.

    Args:
        argument: The topic; `DEFAULT_TOPIC` if empty.
        clock: Measures how long a stick is held.

    Raises:
        BadInput: If it is not a valid topic, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """

    def __init__(self, argument: str, clock: Clock) -> None:
        topic = checked_topic(argument or DEFAULT_TOPIC)
        self._silence = Silence(topic, SILENCE_MS, clock)
        self._waiting: deque[HandMotion] = deque(maxlen=MAX_WAITING)
        self._steering = JoySteering(self._waiting.append, clock)
        self._node = Node()
        self._node.subscribe(topic, Joy, self._receive, self._silence.reject)

    @staticmethod
    def found() -> dict[str, str]:
        """Return the joysticks on the network: the argument of each."""
        published = topics_found(Node.published).items()
        return {f"joy:{topic}": "on the ROS 2 network" for topic, kind in published if kind.endswith("Joy_")}

    def take(self) -> Sequence[HandMotion]:
        """Return the motions since the last call."""
        self._silence.check()
        return tuple(self._waiting.popleft() for _ in range(len(self._waiting)))

    def close(self) -> None:
        """Leave the network."""
        self._node.close()

    def _receive(self, message: Joy) -> None:
        self._steering.take(message)
        self._silence.heard()
