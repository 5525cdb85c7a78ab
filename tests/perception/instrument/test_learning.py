import numpy as np
import pytest

from haptigraph.errors import BadInput
from haptigraph.perception.instrument.learning import MIN_VOLUMES, learn_instrument, usable_rows


def test_too_few_volumes_are_refused():
    with pytest.raises(BadInput, match=f"at least {MIN_VOLUMES} volumes; found 3"):
        learn_instrument([np.zeros((64, 8, 8), np.uint8)] * 3, (0.01, 0.05, 0.05))


def test_volumes_without_instrument_are_refused():
    with pytest.raises(BadInput, match="show a bright instrument"):
        learn_instrument([np.zeros((64, 8, 8), np.uint8)] * 10, (0.01, 0.05, 0.05))


def test_only_rows_that_are_bright_in_almost_every_volume_are_reflections():
    volumes = [np.zeros((64, 8, 8), np.uint8) for _ in range(20)]
    for number, volume in enumerate(volumes):
        volume[10] = 200
        volume[40] = 200 if number % 2 else 0
    np.testing.assert_array_equal(np.flatnonzero(~usable_rows(volumes)), [9, 10, 11])
