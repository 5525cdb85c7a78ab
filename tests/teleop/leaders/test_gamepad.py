import pytest

pytest.importorskip("sdl2", exc_type=ImportError)

from leader_rigs import GamepadRig

from haptigraph.errors import BadInput, DeviceError
from haptigraph.teleop.leaders.gamepad import GamepadLeader
from haptigraph.teleop.leaders.sticks import SPEED_MM_S

LEFT_X, LEFT_Y, RIGHT_Y, LEFT_TRIGGER, RIGHT_TRIGGER = 0, 1, 3, 4, 5


@pytest.fixture
def rig():
    rig = GamepadRig()
    rig.hold(True)
    rig.leader.take()
    yield rig
    rig.close()


@pytest.mark.parametrize(
    ("axis", "deflection", "field", "sign"),
    [
        (LEFT_Y, 1.0, "along_mm", 1),
        (LEFT_Y, -1.0, "along_mm", -1),
        (LEFT_X, 1.0, "across_mm", 1),
        (RIGHT_Y, 1.0, "outwards_mm", 1),
        (LEFT_TRIGGER, 1.0, "apart_mm", 1),
        (RIGHT_TRIGGER, 1.0, "apart_mm", -1),
    ],
)
def test_full_deflection_moves_at_full_speed(rig, axis, deflection, field, sign):
    rig.pad.tilt(axis, deflection)
    moved_mm = 0.0
    for _ in range(20):
        rig.wait(10)
        (motion,) = rig.leader.take()
        moved_mm += getattr(motion, field)
    assert moved_mm == pytest.approx(sign * 0.2 * SPEED_MM_S)


def test_a_stick_near_its_centre_moves_nothing(rig):
    rig.pad.tilt(LEFT_Y, 0.1)
    rig.wait()
    (motion,) = rig.leader.take()
    assert motion.engaged and motion.along_mm == 0


def test_an_unplugged_controller_is_reported(rig):
    rig.lose()
    with pytest.raises(DeviceError, match="controller 0 was unplugged"):
        rig.leader.take()
    with pytest.raises(DeviceError, match="controller 0 is not connected; 0 are"):
        rig.leader.take()


def test_an_invalid_controller_is_refused(rig):
    with pytest.raises(BadInput, match="gamepad:x is not a controller; use gamepad:0 for the first one"):
        GamepadLeader("x", rig.clock)
    with pytest.raises(BadInput, match="gamepad:7: controller 7 is not connected; 1 are"):
        GamepadLeader("7", rig.clock)
