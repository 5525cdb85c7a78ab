"""A learned needle, as the perceiver `volume` reports it."""

import numpy as np
import pytest
from needle_volumes import SHAPE, VOXEL_MM

from haptigraph.config import PerceptionConfig
from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.perception.instrument.finding import find_instrument
from haptigraph.perception.instrument.model_file import save_instrument
from haptigraph.perception.volume.perceiver import VolumePerceiver
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.text import scan_registration_text


def registration_of(voxel_mm=VOXEL_MM):
    axial_mm, slice_mm, lateral_mm = voxel_mm
    size_px, volume = (SHAPE[2], SHAPE[0]), (SHAPE[1], slice_mm)
    return parse_registration(scan_registration_text(size_px, axial_mm, lateral_mm, "t", volume=volume), "r")


@pytest.fixture
def settings(learned, tmp_path):
    file = tmp_path / "needle.npz"
    save_instrument(learned[0], file)
    return PerceptionConfig(model=str(file))


def test_its_pose_becomes_tip_shaft_and_bevel_without_a_retina(learned, settings):
    model, _, (volumes, _) = learned
    image = volumes[0].reshape(SHAPE[0], -1)
    seen = VolumePerceiver(registration_of(), settings)(Capture(0, 0, image))
    pose = find_instrument(volumes[0], model)
    assert set(seen.found) == {"needle_tip", "needle_line", "needle_bevel", "needle_tip_ahead"}
    tip, line = seen.found["needle_tip"], seen.found["needle_line"]
    assert np.allclose((*tip.at_mm, tip.z_mm), pose.tip_mm)
    assert np.allclose(np.array(line.along_mm) / np.linalg.norm(line.along_mm), pose.axis)
    assert seen.certainty.tip_sd_mm == pytest.approx(max(pose.tip_sd_mm))
    assert 0 < seen.certainty.confidence < 1


def test_without_it_nothing_is_found(settings):
    noise = np.random.default_rng(5).integers(0, 40, SHAPE).astype(np.uint8).reshape(SHAPE[0], -1)
    assert VolumePerceiver(registration_of(), settings)(Capture(0, 0, noise)).found == {}


def test_a_model_of_other_voxels_is_refused(settings):
    other_mm = VOXEL_MM[0] * 1.1, *VOXEL_MM[1:]
    with pytest.raises(BadInput, match=r"needle\.npz: was learned from volumes of 240 rows and voxels of"):
        VolumePerceiver(registration_of(other_mm), settings)
