"""Lines that resemble a needle: they add light and cast no shadow."""

import numpy as np
import pytest

from haptigraph.sim.oct.mimics import Mimics, MimicSettings

WIDTH, HEIGHT = 256, 200
ILM, RPE = (np.full(WIDTH, row, np.float32) for row in (80.0, 130.0))


def level():
    tissue = np.full((HEIGHT, WIDTH), 1e-6, np.float32)
    tissue[80:] = 50
    return tissue


def apply(seed=3, **settings):
    return Mimics(MimicSettings(**settings), (WIDTH, HEIGHT), (0.01, 0.004), seed).apply(level(), ILM, RPE)


def test_by_default_nothing_is_added():
    assert np.array_equal(apply(), level())


@pytest.mark.parametrize("kind", ["ghosts", "membranes", "walls", "lines"])
def test_lines_add_light_and_block_none(kind):
    drawn = [apply(seed, **{kind: 3}) - level() for seed in range(4)]
    assert all((added >= 0).all() for added in drawn)
    assert max(float(added.max()) for added in drawn) > 3


def test_the_folded_image_is_fainter_and_upside_down():
    added = apply(folded_db=-10) - level()
    assert added.max() == pytest.approx(5, rel=0.2)
    rows = added.mean(axis=1)
    assert rows[: HEIGHT // 2].max() > 1


def test_a_vignette_darkens_one_side():
    light = apply(vignette_db=20)[150] / 50
    assert min(light[0], light[-1]) < 0.05
    assert max(light[0], light[-1]) == pytest.approx(1)
