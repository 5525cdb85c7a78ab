import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.perception.oct.class_maps import border_rows, line_rows

HEIGHT, WIDTH, ROW_MM = 96, 128, 0.0066


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
    found = border_rows(np.clip(1 - below - noise, 0, 1), np.clip(below - noise, 0, 1), 0.5, ROW_MM)
    assert found.is_visible.all()
    assert np.abs(found.rows - true).max() < 0.35
    assert np.abs(np.median(found.rows - true)) < 0.1


def test_without_either_class_no_border_is_visible():
    true = surface(50, 0.1, 0)
    below = shares_below(true)
    above = 1 - below
    above[:, :40] = below[:, :40] = 0.02  # the needle's shadow
    found = border_rows(above, below, 0.5, ROW_MM)
    assert not found.is_visible[:38].any()
    assert found.is_visible[42:].all()
    assert np.abs((found.rows - true)[42:]).max() < 0.2


def test_speckle_does_not_divert_the_path():
    rng = np.random.default_rng(3)
    true = surface(50, 0.1, 2)
    below = shares_below(true)
    spots = rng.random(below.shape) < 0.03
    below[spots] = 1 - below[spots]
    found = border_rows(1 - below, below, 0.3, ROW_MM)
    assert np.percentile(np.abs(found.rows - true), 95) < 1.2


def test_a_thin_class_is_located_at_its_centre():
    true = surface(45, -0.1, 3)
    on = np.exp(-(((np.arange(HEIGHT)[:, None] - true) / 1.2) ** 2)).astype(np.float32)
    on[:, 100:] = 0.01
    found = line_rows(on, 0.5)
    assert found.is_visible[:100].all() and not found.is_visible[100:].any()
    assert np.abs((found.rows - true)[:100]).max() < 0.15


def test_columns_with_two_candidates_are_left_out():
    """Between two borders, as of RPE and choroid, the network is undecided: neither is reported."""
    below = shares_below(surface(40, 0, 0))
    below[40:56, 60:90] = 0.5
    found = border_rows(1 - below, below, 0.5, ROW_MM)
    assert not found.is_visible[60:90].any()
    assert found.is_visible[:58].all() and found.is_visible[92:].all()


def test_a_surface_below_its_own_lower_class_is_left_out():
    """A patch of the lower class above the path contradicts it, even at a distance."""
    below = shares_below(surface(60, 0, 0))
    below[30:33, 60:90] = 1
    found = border_rows(1 - below, below, 0.3, ROW_MM)
    assert not found.is_visible[62:88].any()
    assert found.is_visible[:58].all() and found.is_visible[92:].all()


def test_the_contradiction_that_is_tolerated_is_a_length():
    """The same patch in a scan of a third of the scale is thinner in millimetres."""
    below = shares_below(surface(60, 0, 0))
    below[30:33, 60:90] = 1
    found = border_rows(1 - below, below, 0.3, ROW_MM / 4)
    assert found.is_visible[62:88].all()


def test_columns_beside_a_jump_are_left_out():
    true = np.where(np.arange(WIDTH) < 64, 40.0, 45.5)
    below = shares_below(true)
    found = border_rows(1 - below, below, 0.3, ROW_MM)
    assert not found.is_visible[62:66].all()
    assert found.is_visible[:60].all() and found.is_visible[68:].all()


def test_a_thin_class_in_two_places_is_left_out():
    true = surface(45, 0, 0)
    on = np.exp(-(((np.arange(HEIGHT)[:, None] - true) / 1.2) ** 2)).astype(np.float32)
    on[70:73, 30:60] = 0.9
    found = line_rows(on, 0.5)
    assert not found.is_visible[30:60].any()
    assert found.is_visible[:30].all() and found.is_visible[60:].all()


def test_nothing_is_visible_in_a_map_without_evidence():
    nothing = np.full((HEIGHT, WIDTH), 0.01, np.float32)
    assert not border_rows(nothing, nothing, 0.5, ROW_MM).is_visible.any()


def test_where_the_network_is_undecided_a_costly_border_is_higher():
    true = surface(50, 0.1, 1)
    sharp = shares_below(true)
    x = np.arange(HEIGHT)[:, None] + 0.5 - true
    soft = (1 / (1 + np.exp(-x / 2))).astype(np.float32)
    shifts = []
    for below in (sharp, soft):
        even, costly = (border_rows(1 - below, below, 0.3, ROW_MM, cost) for cost in (1.0, 4.0))
        shifts.append(np.median(costly.rows - even.rows))
    assert -0.5 < shifts[0] <= 0.01
    assert shifts[1] < -1.5
