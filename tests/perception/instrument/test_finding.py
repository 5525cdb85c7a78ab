import numpy as np
import pytest
from needle_volumes import AXIS, REFLECTION, SHAPE, grid_mm, needle_volume

from haptigraph.errors import BadInput
from haptigraph.perception.instrument.finding import find_instrument
from haptigraph.perception.instrument.rotations import mean_rotation, rotation_vector


def errors(model, volumes, poses, frame=None):
    """Return errors of tips [mm] and of rotation vectors [deg], and the model's frame in the needle's."""
    found = [find_instrument(volume, model) for volume in volumes]
    assert None not in found
    pairs = list(zip(poses, found, strict=True))
    turn, shift = frame or (
        mean_rotation(rotation.T @ each.rotation for (rotation, _), each in pairs),
        np.mean([each.rotation.T @ (each.tip_mm - tip) for (_, tip), each in pairs], axis=0),
    )
    tips = np.array([each.tip_mm - tip - each.rotation @ shift for (_, tip), each in pairs])
    turns = [rotation_vector((rotation @ turn).T @ each.rotation) for (rotation, _), each in pairs]
    return tips, np.rad2deg(turns), (turn, shift)


def test_poses_of_other_volumes_are_found_within_their_standard_deviations(learned):
    model, calibration, others = learned
    _, _, frame = errors(model, *calibration)
    tips, turns, _ = errors(model, *others, frame)
    assert np.median(np.linalg.norm(tips, axis=1)) < 0.004
    z = np.abs(tips / model.tip_sd_mm).ravel()
    assert 0.6 < np.percentile(z, 68) < 1.4
    assert np.percentile(z, 95) < 2.6
    across = np.linalg.svd(model.axis[None])[2][1:]
    assert 0.4 < np.percentile(np.abs(turns @ across.T / model.axis_sd_deg), 68) < 1.4
    assert 0.4 < np.percentile(np.abs(turns @ model.axis / model.roll_sd_deg), 68) < 1.6
    assert model.axis_sd_deg < 0.1


def test_the_axis_is_that_of_the_shaft_and_the_tip_lies_at_its_end(learned):
    model, (volumes, poses), _ = learned
    found = find_instrument(volumes[0], model)
    rotation, tip_mm = poses[0]
    assert np.degrees(np.arccos(found.axis @ rotation @ AXIS)) < 4
    assert np.linalg.norm(found.tip_mm - tip_mm) < 0.2
    side = np.cross(AXIS, [0.0, 0.0, 1.0])
    assert found.bevel @ rotation @ (side / np.linalg.norm(side)) > 0.9
    assert found.bevel @ found.axis == pytest.approx(0, abs=1e-9)


def test_fixed_reflections_are_left_out(learned):
    is_usable = learned[0].is_usable
    assert not is_usable[REFLECTION].any()
    assert is_usable.sum() >= SHAPE[0] - 7


def test_the_order_in_memory_does_not_matter(learned):
    model, (volumes, _), _ = learned
    a, b = (find_instrument(order(volumes[3]), model) for order in (np.ascontiguousarray, np.asfortranarray))
    np.testing.assert_array_equal(a.tip_mm, b.tip_mm)
    np.testing.assert_array_equal(a.rotation, b.rotation)


def test_what_is_no_such_needle_is_not_found(learned):
    model = learned[0]
    rng = np.random.default_rng(5)
    assert find_instrument(np.zeros(SHAPE, np.uint8), model) is None
    assert find_instrument(rng.integers(0, 256, SHAPE, np.uint8), model) is None
    slab = np.full(SHAPE, 5, np.uint8)
    slab[100:130, 4:28, 5:30] = 220
    assert find_instrument(slab, model) is None
    hardly_visible = needle_volume(rng, np.eye(3), np.array([-1.0, 0.6, -1.1]), grid_mm())
    assert find_instrument(hardly_visible, model) is None


def test_volumes_of_another_scanner_are_refused(learned):
    with pytest.raises(BadInput, match="learned from volumes of uint8 with 240 rows; found uint8 of shape"):
        find_instrument(np.zeros((200, 8, 8), np.uint8), learned[0])
