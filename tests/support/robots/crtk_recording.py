"""Record simulated messages of a CRTK arm as `robot check` does, without a network."""

import arm_motion
from crtk_messages import START_NS

from haptigraph.robot.checking.recorded import Recorded
from haptigraph.robot.setup import EyePlace, RcmPlace, RobotSetup
from haptigraph.ros2.geometry_types import JointState, Pose, Quaternion, Vector3
from haptigraph.ros2.motion_types import OperatingState, PoseStamped, Twist, TwistStamped
from haptigraph.ros2.types import Header, Point, Time

RCM_MM = tuple((1e3 * arm_motion.RCM_M).tolist())
SETUP = RobotSetup(
    rcm=RcmPlace(RCM_MM),
    eye=EyePlace((RCM_MM[0], RCM_MM[1], RCM_MM[2] - 12.0), (0.0, 0.0, 0.0, 1.0)),
)


def message_of(sent):
    """The ROS message of a simulated one."""
    header = Header(Time.from_ns(sent.stamp_ns), sent.frame_id)
    numbers = tuple(map(float, sent.numbers))
    if sent.topic == "measured_cp":
        return PoseStamped(header, Pose(Point(*numbers[:3]), Quaternion(*numbers[3:])))
    if sent.topic == "measured_cv":
        return TwistStamped(header, Twist(Vector3(*numbers[:3]), Vector3(*numbers[3:])))
    if sent.topic == "measured_js":
        return JointState(header, arm_motion.JOINT_NAMES, list(numbers), [], [])
    return OperatingState(header, sent.state, sent.is_homed, False)


def recorded(messages):
    """What `robot check` records of messages."""
    record = Recorded(START_NS)
    take = {
        "measured_cp": record.take_pose,
        "measured_cv": record.take_twist,
        "measured_js": record.take_joints,
        "operating_state": record.take_state,
    }
    for sent in messages:
        take[sent.topic](message_of(sent), sent.arrival_ns, sent.sender)
    return record
