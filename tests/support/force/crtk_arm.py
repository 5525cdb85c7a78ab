"""An arm with the CRTK interface in this process: it publishes its pose at 200 Hz, and takes forces."""

import threading

from ros_network import Peer

PERIOD_S = 0.005


class Arm:
    """One arm. Its fields may be changed at any time."""

    def __init__(self, namespace="/MTML", wrench="servo_cf"):
        from haptigraph.ros2.motion_types import PoseStamped, TwistStamped, WrenchStamped
        from haptigraph.ros2.types import Joy

        self.at_m, self.velocity_m_s = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self.is_present, self.is_clutched, self.is_silent = False, False, False
        self.forces = []
        """Every force that arrived, in the arm's axes [N]."""
        self.peer = Peer()
        node = self.peer.node
        self.poses = node.publisher(f"{namespace}/measured_cp", PoseStamped)
        self.twists = node.publisher(f"{namespace}/measured_cv", TwistStamped)
        self.operator = node.publisher("/console/operator_present", Joy)
        self.pedal = node.publisher("/footpedals/clutch", Joy)
        node.subscribe(f"{namespace}/{wrench}", WrenchStamped, self.take, self.peer.rejected.append)
        self.ends = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def take(self, message):
        force = message.wrench.force
        self.forces.append((force.x, force.y, force.z))

    def run(self):
        from haptigraph.ros2.geometry_types import Pose, Quaternion, Vector3
        from haptigraph.ros2.motion_types import PoseStamped, Twist, TwistStamped
        from haptigraph.ros2.types import Header, Joy, Point

        while not self.ends.wait(PERIOD_S):
            if self.is_silent:
                continue
            self.twists.send(TwistStamped(Header(), Twist(Vector3(*self.velocity_m_s))))
            self.operator.send(Joy(Header(), [], [int(self.is_present)]))
            self.pedal.send(Joy(Header(), [], [int(self.is_clutched)]))
            self.poses.send(PoseStamped(Header(), Pose(Point(*self.at_m), Quaternion())))

    def close(self):
        self.ends.set()
        self.thread.join()
        self.peer.node.close()
