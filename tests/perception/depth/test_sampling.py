"""Half-widths and depths along a drawn shaft."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.messages import DepthImage
from haptigraph.perception.depth.sampling import sample

HEIGHT, WIDTH, MIDDLE, HALF_PX, MAX_HALF_PX = 41, 240, 20, 4.0, 6.0
DEPTH = DepthImage(np.full((HEIGHT, WIDTH), 800, np.uint16), 0.1)
ENDS_PX = (0.0, float(MIDDLE)), (float(WIDTH), float(MIDDLE))
VISIBLE = np.zeros(WIDTH, np.bool_)


def drawn(half_px, highlight_columns=0, highlight_grey=250):
    """A dark shaft, with a highlight along its first columns, (h, w)."""
    rows = np.abs(np.arange(HEIGHT) - MIDDLE)[:, None]
    image = np.where(rows <= np.broadcast_to(half_px, WIDTH), 60, 130)
    image[(rows <= 1)[:, 0], :highlight_columns] = highlight_grey
    return np.asarray(image, np.uint8)


def test_a_highlight_along_a_part_of_the_shaft_is_not_its_width():
    blocks = sample(drawn(HALF_PX, WIDTH // 2), DEPTH, ENDS_PX, MAX_HALF_PX, VISIBLE)
    assert len(blocks.half_px) == WIDTH // 6
    assert np.abs(blocks.half_px - HALF_PX).max() < 1.0


@given(st.integers(0, 2**16))
def test_a_shaft_is_nowhere_thinner_than_nearer_to_its_tip(seed):
    noise = np.random.default_rng(seed).integers(0, 60, (HEIGHT, WIDTH))
    image = np.asarray(drawn(np.linspace(5, 2, WIDTH)) + noise, np.uint8)
    assert np.diff(sample(image, DEPTH, ENDS_PX, MAX_HALF_PX, VISIBLE).half_px).max() < 1e-9


def test_depths_of_a_shaft_that_is_thinner_than_its_edges_do_not_count():
    thin_px = np.linspace(3, 0.5, WIDTH)
    blocks = sample(drawn(thin_px), DEPTH, ENDS_PX, MAX_HALF_PX, VISIBLE, thin_px)
    assert blocks.half_px.min() >= 1.5
    assert len(blocks.half_px) < WIDTH // 6
    assert np.abs(1 / blocks.inverse_per_mm - 80).max() < 0.1
