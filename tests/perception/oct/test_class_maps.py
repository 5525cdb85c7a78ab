import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.perception.oct.class_maps import border_rows, line_rows

HEIGHT, WIDTH = 96, 128


def shares_below(row, height=HEIGHT):
    """Share of every pixel that is below a surface, (h, w): exact at the border."""
    return np.clip(np.arange(height)[:, None] + 0.5 - row, 0, 1).astype(np.float32)


def surface(middle, slope, waves):
    x = np.arange(WIDTH)
    return middle + slope * (x - WIDTH / 2) + waves * np.sin(x / 15)


@given(st.floats(30, 60), st.floats(-0.25, 0.25), st.floats(0, 4), st.integers(0, 9))
@settings(max_examples=40, deadline=None)
def test_a_border_is_found_with_sub_pixel_accuracy(middle, slope, waves, seed):
    true = surface(middle, slope, waves)
    below = shares_below(true)
    noise = np.random.default_rng(seed).uniform(0, 0.02, below.shape).astype(np.float32)
    found = border_rows(np.clip(1 - below - noise, 0, 1), np.clip(below - noise, 0, 1), 0.5)
    assert found.is_visible.all()
    assert np.abs(found.rows - true).max() < 0.35
    assert np.abs(np.median(found.rows - true)) < 0.1


def test_without_either_class_no_border_is_visible():
    true = surface(50, 0.1, 0)
    below = shares_below(true)
    above = 1 - below
    above[:, :40] = below[:, :40] = 0.02  # the needle's shadow
    found = border_rows(above, below, 0.5)
    assert not found.is_visible[:38].any()
    assert found.is_visible[42:].all()
    assert np.abs((found.rows - true)[42:]).max() < 0.2


def test_speckle_does_not_divert_the_path():
    rng = np.random.default_rng(3)
    true = surface(50, 0.1, 2)
    below = shares_below(true)
    spots = rng.random(below.shape) < 0.03
    below[spots] = 1 - below[spots]
    found = border_rows(1 - below, below, 0.3)
    assert np.percentile(np.abs(found.rows - true), 95) < 1.2


def test_a_thin_class_is_located_at_its_centre():
    true = surface(45, -0.1, 3)
    on = np.exp(-(((np.arange(HEIGHT)[:, None] - true) / 1.2) ** 2)).astype(np.float32)
    on[:, 100:] = 0.01
    found = line_rows(on, 0.5)
    assert found.is_visible[:100].all() and not found.is_visible[100:].any()
    assert np.abs((found.rows - true)[:100]).max() < 0.15
