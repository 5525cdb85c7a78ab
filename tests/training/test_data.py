import numpy as np
import pytest

from haptigraph.sim.oct.bscan import CLASSES
from haptigraph.sim.oct.scenes import random_scene
from training.data import SIDE_PX, Example, batches, draw, simulate


@pytest.fixture(scope="module")
def examples():
    return [simulate(number, 500) for number in range(3)]


def test_an_example_has_grey_from_0_to_1_and_shares_that_sum_to_1(examples):
    image, shares = draw(examples[0], np.random.default_rng(1))
    assert image.shape == (1, SIDE_PX, SIDE_PX)
    assert shares.shape == (len(CLASSES), SIDE_PX, SIDE_PX)
    assert 0 <= image.min() < image.max() <= 1
    assert np.allclose(shares.sum(axis=0), 1, atol=0.02)


def test_the_same_seed_draws_the_same_batches(examples):
    one, other = (list(batches(examples, 2, 3, np.random.default_rng(4))) for _ in range(2))
    for (images, shares), (same_images, same_shares) in zip(one, other, strict=True):
        assert np.array_equal(images, same_images)
        assert np.array_equal(shares, same_shares)


def test_every_example_is_used_once_before_any_is_repeated(examples):
    marked = [
        Example(np.full((512, 512), 60 * number, np.uint8), examples[0].labels) for number in range(1, 4)
    ]
    means = [
        image.mean() for images, _ in batches(marked, 1, 3, np.random.default_rng(0)) for image in images
    ]
    assert len({round(10 * float(mean)) for mean in means}) == 3


class NoAugmentation:
    """A random generator that disables augmentation: no flip, no crop, no change of contrast."""

    def random(self):
        return 0.99

    def uniform(self, low, high):
        return high

    def integers(self, low, high):
        return low

    def normal(self, mean, sd):
        return mean


def test_shares_encode_the_sub_pixel_position_of_a_border():
    scene = random_scene(5, 500, place="none")
    camera = scene.camera()
    truth = (scan := scene.take(camera)).truth
    _, shares = draw(Example(scan.image, camera.classes(truth)), NoAugmentation())
    above = shares[CLASSES.index("vitreous"), : SIDE_PX // 2 + 60]
    ilm_px = truth.ilm_px.reshape(-1, 2).mean(axis=1)
    inside = (ilm_px > 20) & (ilm_px < SIDE_PX)
    rows_px = 2 * above.sum(axis=0) - 0.5  # number of rows above the ILM, in the full image
    assert np.abs(np.median((rows_px - ilm_px)[inside])) < 0.2


def test_a_cycle_of_ten_mixes_needles_and_plain_and_detailed_tissue():
    labels = [simulate(number, 500).labels for number in range(10)]
    has_needle = [CLASSES.index("needle") in one for one in labels]
    assert has_needle == [True] * 5 + [False] * 5


def test_everything_below_the_rpe_is_one_class(examples):
    below = CLASSES.index("rpe_choroid")
    for example in examples:
        last = example.labels[-1]
        assert (last == below).any()
        assert set(np.unique(last)) <= {below, CLASSES.index("shadow"), CLASSES.index("needle")}


def test_blanked_columns_are_labelled_as_without_tissue():
    class AlwaysPadded(NoAugmentation):
        def __init__(self):
            self.first = True

        def random(self):
            was_first, self.first = self.first, False
            return 0.0 if was_first else 0.99

    example = Example(np.full((512, 512), 90, np.uint8), np.full((512, 512), 2, np.uint8))
    image, shares = draw(example, AlwaysPadded())
    blank = image[0].mean(axis=0) < 0.05
    assert 0.25 < blank.mean() < 0.35
    assert (shares[CLASSES.index("shadow")][:, blank] > 0.9).all()
    assert (shares[2][:, ~blank] > 0.4).all()
