import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.perception.oct.class_edges import PROFILE_VALUES, profiles, transmits_light, upper_edge

MM_PER_PX = 0.008, 0.003
WIDTH, COLUMNS = 512, 128
EVERYWHERE = np.ones(COLUMNS, bool)
DARK, BRIGHT = 60, 160


def bands(first_px, second_px=None, *, share=1.0, size=(256, WIDTH)):
    """Two bright bands of 15 µm below dark tissue, the lower of which may be the only one; and its border."""
    x = np.arange(size[1])
    curve = 12 * np.sin(x / 90)
    image = np.full(size, DARK, np.float32)
    y = np.arange(size[0])[:, None] + 0.5
    for row_px, contrast in ((first_px, share), (second_px, 1.0)):
        if row_px is not None:
            inside = np.clip(y - row_px - curve, 0, 1) * np.clip(row_px + curve + 5 - y, 0, 1)
            image += (BRIGHT - DARK) * contrast * inside
    return image.round().astype(np.uint8), curve.reshape(COLUMNS, -1).mean(axis=1)


def noisy(image, seed, sd_grey=15):
    noise = np.random.default_rng(seed).normal(0, sd_grey, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


@given(st.floats(-4, 0), st.integers(0, 9))
@settings(max_examples=30, deadline=None)
def test_a_border_just_above_an_edge_moves_onto_it(off_px, seed):
    image, curve = bands(120)
    row_px, is_first = upper_edge(noisy(image, seed), 120 - 0.5 + curve + off_px, MM_PER_PX)
    assert is_first.all()
    assert np.abs(np.median(row_px - curve - 119.5)) < 1
    assert np.percentile(np.abs(row_px - curve - 119.5), 95) < 1.6


def test_below_another_edge_a_border_is_not_confirmed():
    image, curve = bands(107, 120)
    image[:, 256:] = bands(None, 120)[0][:, 256:]
    _, is_first = upper_edge(noisy(image, 1), 119.5 + curve, MM_PER_PX)
    assert not is_first[:60].any()
    assert is_first[68:].all()


@pytest.mark.parametrize(("share", "confirmed"), [(0.1, True), (0.5, False)])
def test_a_faint_edge_above_does_not_count(share, confirmed):
    image, curve = bands(107, 120, share=share)
    _, is_first = upper_edge(image, 119.5 + curve, MM_PER_PX)
    assert (is_first == confirmed).all()


def test_without_any_edge_a_border_is_not_confirmed():
    _, is_first = upper_edge(np.full((256, WIDTH), DARK, np.uint8), np.full(COLUMNS, 120.0), MM_PER_PX)
    assert not is_first.any()


@pytest.mark.parametrize("scale", [0.7, 1.5, 2.0])
def test_lengths_are_physical(scale):
    image, curve = bands(107, 120)
    image[:, 256:] = bands(None, 120)[0][:, 256:]
    at_px = 117.5 + curve
    other = cv2.resize(image, None, fx=1, fy=scale, interpolation=cv2.INTER_LINEAR)
    other_px = (at_px + 0.5) * scale - 0.5
    (row_px, is_first), (scaled_px, is_first_too) = (
        upper_edge(image, at_px, MM_PER_PX),
        upper_edge(other, other_px, (MM_PER_PX[0], MM_PER_PX[1] / scale)),
    )
    assert (is_first == is_first_too).mean() > 0.95
    assert np.abs((scaled_px + 0.5) / scale - 0.5 - row_px).max() < 1.1


def retina(below, above=110, dark=20, bright=200):
    """Dark vitreous, tissue from row 60 on, and below the bright band at row 120 so bright a choroid."""
    image = np.full((256, WIDTH), dark, np.float32)
    image[60:120] = above
    image[120:135] = bright
    image[135:] = np.interp(np.arange(WIDTH), (0, 200, 312, WIDTH), (below[0], below[0], below[1], below[1]))
    return image.round().astype(np.uint8)


@pytest.mark.parametrize("gain", [0.6, 1.0])
def test_where_the_choroid_shines_light_is_transmitted(gain):
    image = (gain * noisy(retina((90, 240)), 2)).astype(np.uint8)
    transmits = transmits_light(image, np.full(COLUMNS, 119.5), MM_PER_PX)
    assert not transmits[:50].any()
    assert transmits[78:].all()


@pytest.mark.parametrize("grey", [0, 130, 255])
def test_no_light_is_transmitted_in_a_blank_image(grey):
    image = np.full((256, WIDTH), grey, np.uint8)
    assert not transmits_light(image, np.full(COLUMNS, 120.0), MM_PER_PX).any()


@pytest.mark.parametrize("scale", [0.7, 1.5, 2.0])
def test_transmitted_light_does_not_depend_on_the_resolution(scale):
    image = noisy(retina((90, 240)), 3, sd_grey=5)
    other = cv2.resize(image, None, fx=1, fy=scale, interpolation=cv2.INTER_LINEAR)
    rows_px = np.full(COLUMNS, 119.5)
    one = transmits_light(image, rows_px, MM_PER_PX)
    same = transmits_light(other, (rows_px + 0.5) * scale - 0.5, (MM_PER_PX[0], MM_PER_PX[1] / scale))
    assert (one == same).mean() > 0.95


def test_a_profile_shows_the_tissue_across_a_border():
    image = retina((90, 90))
    values = profiles(image, np.full(COLUMNS, 119.5), EVERYWHERE, MM_PER_PX)
    assert values.shape == (COLUMNS, PROFILE_VALUES)
    across = values.reshape(COLUMNS, 3, -1)
    assert across[:, :, 20:44].mean() == pytest.approx((110 - 20) / (200 - 20), abs=0.02)
    assert across[:, :, 46:51].mean() == pytest.approx(1, abs=0.05)


@given(st.floats(0.5, 1.0), st.integers(0, 40))
@settings(max_examples=20, deadline=None)
def test_a_profile_does_not_depend_on_brightness_and_contrast(gain, offset):
    image = noisy(retina((90, 130)), 4)
    row_px = np.full(COLUMNS, 119.5)
    one, other = (
        profiles(each, row_px, EVERYWHERE, MM_PER_PX)
        for each in (image, np.clip(gain * image + offset, 0, 255).astype(np.uint8))
    )
    assert np.abs(one - other).max() < 0.05


@pytest.mark.parametrize("scale", [0.7, 1.5, 2.0])
def test_a_profile_does_not_depend_on_the_resolution(scale):
    image = noisy(retina((90, 130)), 5, sd_grey=3)
    other = cv2.resize(image, None, fx=1, fy=scale, interpolation=cv2.INTER_LINEAR)
    row_px = np.full(COLUMNS, 119.5)
    one = profiles(image, row_px, EVERYWHERE, MM_PER_PX)
    same = profiles(other, (row_px + 0.5) * scale - 0.5, EVERYWHERE, (MM_PER_PX[0], MM_PER_PX[1] / scale))
    assert np.median(np.abs(one - same)) < 0.02


def test_columns_without_a_border_have_no_profile():
    is_likely = np.arange(COLUMNS) > COLUMNS // 3
    image, row_px = noisy(retina((90, 130)), 6), np.full(COLUMNS, 119.5)
    values = profiles(image, row_px, is_likely, MM_PER_PX)
    assert not values[~is_likely].any()
    assert np.array_equal(values[is_likely], profiles(image, row_px, EVERYWHERE, MM_PER_PX)[is_likely])


def test_a_blank_image_has_flat_profiles():
    image = np.full((256, WIDTH), 130, np.uint8)
    assert not profiles(image, np.full(COLUMNS, 120.0), EVERYWHERE, MM_PER_PX).any()
