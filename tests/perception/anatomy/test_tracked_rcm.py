import math

import pytest
from paths import RENDERINGS

from haptigraph.analysis.registering.registering import all_images
from haptigraph.perception.anatomy.moving_shaft import median_image
from haptigraph.perception.anatomy.rim import find_rim
from haptigraph.perception.anatomy.tracked_rcm import tracked_rcm
from haptigraph.registration.loading import load_registration

RENDERING = RENDERINGS / "golden_thin"


@pytest.fixture(scope="module")
def clip():
    truth = load_registration(RENDERING / "registration.toml")
    images = list(all_images(str(RENDERING / "clip.mp4")))
    return images, find_rim(median_image(images)), truth.image.to_px(truth.trocar.at_mm)


@pytest.mark.parametrize("error_px", [(0.0, 0.0), (8.0, 0.0), (-5.0, 6.0)])
def test_the_rcm_is_measured_from_an_approximate_one(clip, error_px):
    images, rim, true_px = clip
    rcm = tracked_rcm(images, rim, (true_px[0] + error_px[0], true_px[1] + error_px[1]))
    assert math.dist(rcm.point_px, true_px) < 0.6
    assert rcm.lines > 20


def test_without_a_needle_nothing_is_measured(clip):
    images, rim, true_px = clip
    assert tracked_rcm(images[:1] * 6, rim, true_px) is None
