import numpy as np
import pytest

from haptigraph.perception.native.volume import ROWS_PER_CELL, ReducedVolume, Template, reduce_volume

SHAPE = (64, 7, 9)
KERNEL = np.exp(-0.5 * (np.arange(-4, 5) / 1.4) ** 2)


def some_volume(seed=0):
    return np.random.default_rng(seed).integers(0, 256, SHAPE, np.uint8)


def expected_cells(volume, is_usable):
    cells = volume.shape[0] // ROWS_PER_CELL
    usable = is_usable.astype(float)
    sums = (volume * usable[:, None, None]).reshape(cells, ROWS_PER_CELL, *volume.shape[1:]).sum(axis=1)
    counts = usable.reshape(cells, ROWS_PER_CELL).sum(axis=1)
    smooth = [np.convolve(sums[:, i, j], KERNEL, "same") for i in range(SHAPE[1]) for j in range(SHAPE[2])]
    means = np.array(smooth) / np.convolve(counts, KERNEL, "same")
    return 16 * np.sqrt(means).reshape(SHAPE[1], SHAPE[2], cells).transpose(1, 0, 2)


def test_cells_are_smoothed_means_of_usable_rows():
    volume, is_usable = some_volume(), np.ones(64, np.bool_)
    is_usable[20:23] = False
    reduced = reduce_volume(volume, is_usable)
    np.testing.assert_allclose(reduced.cells, expected_cells(volume, is_usable), rtol=1e-4)
    volume[20:23] = 255 - volume[20:23]
    np.testing.assert_array_equal(reduce_volume(volume, is_usable).cells, reduced.cells)


def test_the_order_in_memory_does_not_matter():
    volume, is_usable = some_volume(), np.ones(64, np.bool_)
    cells = reduce_volume(volume, is_usable).cells
    padded = np.zeros((64, 8, 20), np.uint8)
    padded[:, :7, 1:19:2] = volume
    for other in (np.asfortranarray(volume), padded[:, :7, 1:19:2], volume[::-1].copy()[::-1]):
        np.testing.assert_array_equal(reduce_volume(other, is_usable).cells, cells)


def test_cells_without_usable_rows_are_outside():
    is_usable = np.ones(64, np.bool_)
    is_usable[:24] = False
    reduced = reduce_volume(some_volume(), is_usable)
    assert 4 <= reduced.first_cell <= 6
    assert reduced.last_cell == 15
    assert not reduced.cells[:, :, : reduced.first_cell].any()
    with pytest.raises(ValueError, match="some usable rows"):
        reduce_volume(some_volume(), np.zeros(64, np.bool_))


def linear_volume():
    """A reduced volume whose values are 2 column + 3 cell - slice."""
    column, slice_, cell = np.meshgrid(np.arange(9), np.arange(7), np.arange(16), indexing="ij")
    return ReducedVolume((2 * column + 3 * cell - slice_).astype(np.float32), 1, 14)


AFFINE = np.column_stack([np.eye(3), np.zeros(3)])


def test_samples_are_interpolated_inside_and_left_out_outside():
    points = np.array([[1.5, 2.25, 3.5], [0, 1, 0], [0, 0.9, 0], [8.1, 5, 3], [np.nan, 5, 3], [1e30, 5, 3]])
    sums, counts = np.zeros(6, np.float32), np.zeros(6, np.float32)
    linear_volume().add_samples(points.astype(np.float32), AFFINE, sums, counts)
    np.testing.assert_array_equal(counts, [1, 1, 0, 0, 0, 0])
    np.testing.assert_allclose(sums[:2], [3 + 6.75 - 3.5, 3])
    assert not sums[2:].any()


def test_comparison_gives_hubers_cost_and_its_normal_equations():
    rng = np.random.default_rng(1)
    points = rng.uniform([0, 1, 0], [8, 14, 6], (500, 3)).astype(np.float32)
    jacobian = rng.normal(size=(500, 6)).astype(np.float32)
    values = rng.normal(20, 15, 500).astype(np.float32)
    is_used = rng.random(500) < 0.7
    template = Template(points, values, jacobian)
    cost, inside, gradient, normal = linear_volume().compare(template, AFFINE, is_used, 10.0)
    residuals = (points @ [2, 3, -1] - values)[is_used]
    size = np.abs(residuals)
    weights = np.where(size <= 10, 1, 10 / size)
    assert inside == is_used.sum()
    assert cost == pytest.approx(np.where(size <= 10, size**2, 20 * size - 100).mean(), rel=1e-4)
    rows = jacobian[is_used].astype(float)
    np.testing.assert_allclose(gradient, rows.T @ (weights * residuals), rtol=1e-3, atol=0.1)
    np.testing.assert_allclose(normal, (rows * weights[:, None]).T @ rows, rtol=1e-3, atol=0.01)


def test_nothing_inside_costs_infinitely_much():
    template = Template(*(np.zeros(shape, np.float32) for shape in ((1, 3), (1,), (1, 6))))
    shifted = AFFINE - np.column_stack([np.zeros((3, 3)), [50, 50, 50]])
    cost, inside, gradient, normal = linear_volume().compare(template, shifted, np.ones(1, np.bool_), 10.0)
    assert (cost, inside) == (np.inf, 0)
    assert not gradient.any()
    assert not normal.any()


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: reduce_volume(some_volume().astype(np.uint16), np.ones(64, np.bool_)),
        lambda: reduce_volume(some_volume()[0], np.ones(64, np.bool_)),
        lambda: reduce_volume(some_volume(), np.ones(63, np.bool_)),
        lambda: reduce_volume(some_volume()[:4], np.ones(4, np.bool_)),
        lambda: ReducedVolume(np.zeros((2, 2, 8)), 0, 7),
        lambda: ReducedVolume(np.zeros((2, 2, 8), np.float32), 0, 8),
        lambda: Template(*(np.zeros(shape, np.float32) for shape in ((2, 3), (1,), (2, 6)))),
        lambda: Template(*(np.zeros(shape, np.float32) for shape in ((0, 3), (0,), (0, 6)))),
        lambda: linear_volume().add_samples(
            np.zeros((2, 3), np.float32), AFFINE[:, :3], *np.zeros((2, 2), np.float32)
        ),
    ],
)
def test_what_c_cannot_read_is_refused(wrong):
    with pytest.raises((ValueError, TypeError)):
        wrong()
