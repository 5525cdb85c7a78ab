import math

import pytest
from paths import RENDERINGS

from haptigraph.analysis.registering.registering import all_images
from haptigraph.perception.anatomy.moving_shaft import still_picture
from haptigraph.perception.anatomy.rim import find_rim
from haptigraph.perception.anatomy.tracked_rcm import tracked_rcm
from haptigraph.registration.camera import load_registration

RENDERING = RENDERINGS / "golden_thin"


@pytest.fixture(scope="module")
def clip():
    truth = load_registration(RENDERING / "registration.toml")
    images = list(all_images(str(RENDERING / "clip.mp4")))
    return images, find_rim(still_picture(images)), truth.image.to_px(truth.trocar.at_mm)


@pytest.mark.parametrize("off_px", [(0.0, 0.0), (8.0, 0.0), (-5.0, 6.0)])
def test_the_pivot_is_measured_from_wherever_it_was_thought_to_be(clip, off_px):
    images, rim, true_px = clip
    rcm = tracked_rcm(images, rim, (true_px[0] + off_px[0], true_px[1] + off_px[1]))
    assert math.dist(rcm.point_px, true_px) < 0.6
    assert rcm.lines > 20


def test_without_a_needle_nothing_is_measured(clip):
    images, rim, true_px = clip
    assert tracked_rcm(images[:1] * 6, rim, true_px) is None
