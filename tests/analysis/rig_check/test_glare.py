"""Glare at a port opening, and the shaft of an instrument there, which is none."""

import numpy as np
import pytest
from rig_pictures import view, with_shaft
from rig_setups import SABOTAGES, simulated_setup

from haptigraph.analysis.rig_check.glare import glare

SEED, WHITE = 9103, 255
GLARE = SABOTAGES["glare on the port"][0]


@pytest.fixture(scope="module")
def sound():
    return simulated_setup(0, SEED, has_mark=False, has_reference=False)


def found(setup):
    return [finding.name for finding in glare(view(setup)).findings]


@pytest.mark.parametrize("turn_deg", [-35.0, 0.0, 25.0])
def test_a_saturated_shaft_is_no_glare(sound, turn_deg):
    assert found(with_shaft(sound, turn_deg, WHITE)) == []


@pytest.mark.parametrize("severity", [1, 2])
def test_glare_beside_a_saturated_shaft_is_found(sound, severity):
    shafted = with_shaft(sound, 10.0, WHITE)
    assert found(GLARE(shafted, severity, np.random.default_rng(0))) == ["glare"]


def test_a_white_streak_that_ends_at_the_opening_is_glare(sound):
    assert found(with_shaft(sound, 0.0, WHITE, length_mm=2.2)) == ["glare"]
