import numpy as np
import pytest
from needle_volumes import VOXEL_MM, needle_volumes

from haptigraph.perception.instrument.learning import learn_instrument


@pytest.fixture(scope="package")
def learned():
    """Return a model, and volumes with rotations and tips: those that it was learned from, and others."""
    rng = np.random.default_rng(31)
    volumes, poses = needle_volumes(rng, 20)
    return learn_instrument(volumes, VOXEL_MM), (volumes, poses), needle_volumes(rng, 20)
