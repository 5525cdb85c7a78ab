import cv2
import numpy as np
import pytest
from paths import GOLDEN

from haptigraph.perception.forceps.stained_tissue import Stains
from haptigraph.recording.reader import RunReader
from haptigraph.registration.loading import parse_registration

RUN = GOLDEN / "membrane_peeling.mcap"


@pytest.fixture(scope="module")
def run():
    """Every tenth image of an operation on a dyed membrane, and what looks at its tissue."""
    reader = RunReader(RUN)
    images = [capture.image for capture, _ in reader.records() if capture.image is not None]
    return Stains(parse_registration(reader.info.registration, "run")), images[::10]


def test_without_its_dye_an_image_has_no_membrane_and_the_same_blood(run):
    look, images = run
    for image in images:
        found, undyed = look(image)
        assert "membrane_edge" in found
        again, _ = look(undyed)
        assert "membrane_edge" not in again
        assert again["hemorrhage"] == found["hemorrhage"]


def test_what_is_put_in_place_of_dye_is_as_bright_as_what_is_about_it(run):
    look, images = run
    for image in images:
        before = image.copy()
        undyed = look(image)[1]
        assert (image == before).all()
        is_changed = (undyed != image).any(axis=2)
        assert 100 < np.count_nonzero(is_changed) < 0.1 * is_changed.size
        grey = cv2.cvtColor(undyed, cv2.COLOR_BGR2GRAY).astype(float)
        beside = cv2.dilate(is_changed.astype(np.uint8), np.ones((9, 9), np.uint8)).astype(bool) & ~is_changed
        assert abs(np.median(grey[is_changed]) - np.median(grey[beside])) < 12


def test_an_image_without_colour_has_no_tissue_and_stays_as_it_is(run):
    look, images = run
    grey = np.ascontiguousarray(images[0][..., 1])
    found, same = look(grey)
    assert found == {}
    assert same is grey
