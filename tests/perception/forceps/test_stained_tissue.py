import cv2
import numpy as np
import pytest
from paths import GOLDEN

from haptigraph.perception.forceps.stained_tissue import StainedTissue
from haptigraph.recording.reader import RunReader
from haptigraph.registration.loading import parse_registration

RUN = GOLDEN / "membrane_peeling.mcap"


@pytest.fixture(scope="module")
def run():
    """A detector of stained tissue, and every tenth image of an operation on a stained membrane."""
    reader = RunReader(RUN)
    images = [capture.image for capture, _ in reader.records() if capture.image is not None]
    return StainedTissue(parse_registration(reader.info.registration, "run")), images[::10]


def test_removing_the_dye_removes_the_membrane_and_keeps_the_blood(run):
    detect, images = run
    for image in images:
        found, undyed = detect(image)
        assert "membrane_edge" in found
        again, _ = detect(undyed)
        assert "membrane_edge" not in again
        assert again["hemorrhage"] == found["hemorrhage"]


def test_filled_dye_is_as_bright_as_its_surroundings(run):
    detect, images = run
    for image in images:
        before = image.copy()
        undyed = detect(image)[1]
        assert (image == before).all()
        is_changed = (undyed != image).any(axis=2)
        assert 100 < np.count_nonzero(is_changed) < 0.1 * is_changed.size
        grey = cv2.cvtColor(undyed, cv2.COLOR_BGR2GRAY).astype(float)
        beside = cv2.dilate(is_changed.astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool) & ~is_changed
        assert abs(np.median(grey[is_changed]) - np.median(grey[beside])) < 12


def test_a_grey_image_has_no_tissue_and_is_returned_unchanged(run):
    detect, images = run
    grey = np.ascontiguousarray(images[0][..., 1])
    found, same = detect(grey)
    assert found == {}
    assert same is grey
