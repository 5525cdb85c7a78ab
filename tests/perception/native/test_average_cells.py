"""Cells of a B-scan of any size, compared with a mean over pixels drawn larger."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.perception.native.bscan import average_cells

FINE = 16
STEPS = 256  # of a cell in a grey level


def random_image(seed, height=24, width=30):
    return np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)


@settings(max_examples=40)
@given(st.integers(0, 2**31), st.integers(FINE, 24 * FINE), st.integers(FINE, 24 * FINE))
def test_a_cell_is_the_mean_of_the_parts_of_pixels_in_it(seed, across, down):
    image = random_image(seed)
    fine = image.repeat(FINE, 0).repeat(FINE, 1).astype(float)
    cells = average_cells(image, across / FINE, down / FINE)
    assert cells.shape == (fine.shape[0] // down, fine.shape[1] // across)
    for (row, column), cell in np.ndenumerate(cells):
        part = fine[row * down : (row + 1) * down, column * across : (column + 1) * across]
        assert cell / STEPS == pytest.approx(part.mean(), abs=1 / STEPS)


@pytest.mark.parametrize("factor", [2, 3, 5])
def test_an_image_of_more_pixels_has_the_same_cells(factor):
    image = random_image(1)
    finer = image.repeat(factor, 0).repeat(factor, 1)
    cells, same = average_cells(image, 3.2, 2.7), average_cells(finer, factor * 3.2, factor * 2.7)
    assert np.abs(same - cells).max() <= STEPS  # edges are rounded to 256ths of a pixel


@pytest.mark.parametrize(("across", "down"), [(0.9, 2), (2, 0.9), (31, 2), (2, 25), (np.nan, 2), (2, np.inf)])
def test_cells_smaller_than_a_pixel_or_larger_than_the_image_are_refused(across, down):
    with pytest.raises(ValueError, match="cells: expected 1 pixel to the image's size"):
        average_cells(random_image(1), across, down)
