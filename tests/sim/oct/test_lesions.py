"""Lesions: how they deform the surfaces."""

import numpy as np
import pytest

from haptigraph.sim.oct.lesions import COMPLEX_MM, LesionSettings, lesion_profiles
from haptigraph.sim.oct.retina import Surfaces

X_MM = np.linspace(-3, 3, 401)
HEALTHY = Surfaces(0 * X_MM, 0 * X_MM - 0.3, False)


def profiles(**lesions):
    return lesion_profiles(LesionSettings(**lesions), X_MM, 4)


def test_without_lesions_the_surfaces_stay():
    surfaces = profiles().deformed(HEALTHY)
    assert np.array_equal(surfaces.ilm_mm, HEALTHY.ilm_mm)
    assert np.allclose(surfaces.rpe_mm, HEALTHY.rpe_mm, atol=1e-12)


@pytest.mark.parametrize("lesions", [{"drusen": 8, "drusen_mm": 0.1}, {"detachment_mm": 0.2}])
def test_a_lifted_rpe_lifts_the_retina_as_much(lesions):
    surfaces = profiles(**lesions).deformed(HEALTHY)
    lift_mm = surfaces.rpe_mm - HEALTHY.rpe_mm
    assert 0.02 < lift_mm.max() <= 0.2 + 1e-9
    assert lift_mm.min() > -1e-9
    assert np.allclose(surfaces.ilm_mm - HEALTHY.ilm_mm, lift_mm)


def test_subretinal_fluid_lifts_the_retina_and_bares_the_rpe():
    surfaces = profiles(fluid_mm=0.2).deformed(HEALTHY)
    at = int(surfaces.ilm_mm.argmax())
    assert surfaces.ilm_mm[at] == pytest.approx(0.2, abs=0.005)
    assert -COMPLEX_MM < surfaces.rpe_mm[at] - HEALTHY.rpe_mm[at] < 0  # its own edge, above Bruch's membrane
    assert (surfaces.ilm_mm - surfaces.rpe_mm)[at] > 0.3 + 0.2


def test_in_atrophy_the_retina_rests_on_bruchs_membrane():
    found = profiles(atrophy_mm=2.0)
    surfaces = found.deformed(HEALTHY)
    at = int(found.atrophy.argmax())
    assert surfaces.rpe_mm[at] - HEALTHY.rpe_mm[at] == pytest.approx(-COMPLEX_MM, abs=0.002)
    width_mm = (found.atrophy > 0.5).mean() * np.ptp(X_MM)
    assert 0.5 < width_mm <= 2.05


def test_cysts_swell_the_retina_and_leave_the_rpe():
    surfaces = profiles(cysts=6, cyst_mm=0.2).deformed(HEALTHY)
    assert surfaces.ilm_mm.max() > 0.02
    assert np.allclose(surfaces.rpe_mm, HEALTHY.rpe_mm)


def test_a_pit_thins_the_retina():
    assert profiles(pit_mm=0.1).deformed(HEALTHY).ilm_mm.min() == pytest.approx(-0.1, abs=0.005)
