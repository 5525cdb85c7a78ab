"""Passes over regions wider than what is read at once, against plain implementations."""

import numpy as np
import pytest

from haptigraph.perception.native.pixels import LearnedBackground, mark_stains

SIZE_PX = 40, 700
BLUE_GREY, RED_GREY = 22, 60


def make_image(seed: int, stains: int):
    """A dull image with so many pixels in any colour."""
    random = np.random.default_rng(seed)
    image = random.integers(90, 110, (*SIZE_PX, 3), np.uint8)
    rows, columns = (random.integers(0, size, stains) for size in SIZE_PX)
    image[rows, columns] = random.integers(0, 256, (stains, 3))
    return image


@pytest.mark.parametrize("stains", [0, 3, 40, 20_000])
@pytest.mark.parametrize("columns", [slice(0, 700), slice(3, 67), slice(5, 134), slice(636, 700)])
def test_stains_are_the_same_wherever_they_are(stains, columns):
    for seed in range(5):
        image, region = make_image(seed, stains), (slice(1, 40), columns)
        blue, green, red = (image[region][..., k].astype(int) for k in range(3))
        column = np.arange(blue.shape[1])
        spans = np.random.default_rng(seed).integers((0, 40), (30, 701), (len(blue), 2), np.int32)
        is_inside = (column >= spans[:, :1]) & (column < spans[:, 1:])
        expected = (
            (blue - np.maximum(green, red) > BLUE_GREY) & is_inside,
            (red - np.maximum(green, blue) > RED_GREY) & is_inside,
        )
        dye, blood = np.ones((2, *blue.shape), bool)
        found = mark_stains(image, region, BLUE_GREY, RED_GREY, spans, dye, blood)
        np.testing.assert_array_equal((dye, blood), expected)
        for marked, mask in zip(found, expected, strict=True):
            assert marked.count == mask.sum()
            if not marked.count:
                assert mask[marked.within].size == 0
                continue
            rows, columns_of = (each.nonzero()[0] for each in (mask.any(axis=1), mask.any(axis=0)))
            within = slice(rows[0], rows[-1] + 1), slice(columns_of[0], columns_of[-1] + 1)
            assert marked.within == within


@pytest.mark.parametrize("free", [1.0, 0.5])
def test_grey_is_learned_alike_with_and_without_colour(free):
    random, region = np.random.default_rng(2), (slice(3, 37), slice(11, 690))
    shape = 34, 679
    was_visible = random.random(SIZE_PX) < free
    planes = [np.zeros(SIZE_PX, np.float32) for _ in range(3)]
    plain = np.zeros(SIZE_PX, np.float32)
    for seed in range(4):
        image, is_free = make_image(seed, 9_000), random.random(shape) < free
        is_inside, rate = random.random(SIZE_PX) < 0.7, np.where(was_visible[region], 0.25, 1.0) * is_free
        blue, green, red = (image[region][..., k].astype(int) for k in range(3))
        share = np.where(is_inside[region], int(65536 * 0.3), 0)
        whole = ((7471 + share) * blue + 38470 * green + (19595 - share) * red).clip(0, 255 * 65536)
        seen = ((whole + 32768) // 65536).astype(np.float32)
        plain[region] += rate.astype(np.float32) * (seen - plain[region])
        visible = was_visible.copy(), was_visible.copy()
        LearnedBackground(is_inside, visible[0], *planes[:2]).learn(image, region, 0.3, is_free)
        LearnedBackground(is_inside, visible[1], planes[2], None).learn(image, region, 0.3, is_free)
        was_visible[region] |= is_free
        for after in visible:
            np.testing.assert_array_equal(after, was_visible)
    np.testing.assert_array_equal(planes[0], plain)
    np.testing.assert_array_equal(planes[2], plain)
    assert planes[1][region].any() and not planes[1][:3].any()
