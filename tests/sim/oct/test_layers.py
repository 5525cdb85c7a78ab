"""Detailed tissue: bands, choroid and lesions."""

import numpy as np
import pytest

from haptigraph.sim.oct.appearance import BscanAppearance
from haptigraph.sim.oct.layers import DetailedTissue, TissueDetail
from haptigraph.sim.oct.lesions import COMPLEX_MM, LesionSettings

AXIAL_MM, HEIGHT = 0.003, 400
X_MM = np.linspace(-2, 2, 256)
ILM, RPE = (np.full(len(X_MM), row, np.float32) for row in (100.0, 200.0))
PLAIN = BscanAppearance(attenuation_db_per_mm=0)


def decibels(detail, **lesions):
    detail = TissueDetail(lesions=LesionSettings(**lesions), **detail)
    tissue = DetailedTissue(detail, X_MM, AXIAL_MM, HEIGHT, seed=2)
    return tissue, tissue.decibels(ILM, RPE, PLAIN)


def below_mm(db, mm):
    """Mean backscatter at a distance below the ellipsoid zone's upper edge."""
    return float(db[round(200 + mm / AXIAL_MM)].mean())


def test_bands_follow_each_other_down_to_the_choroid():
    _, db = decibels({"zone_db": 21, "gap_db": 12, "rpe_db": 26, "choroid_db": 8, "choroid_db_per_mm": 0})
    assert below_mm(db, 0.008) == pytest.approx(21, abs=0.5)
    assert below_mm(db, 0.028) == pytest.approx(12, abs=0.5)
    assert below_mm(db, 0.052) == pytest.approx(26, abs=0.5)
    assert below_mm(db, COMPLEX_MM + 0.012) == pytest.approx(8, abs=0.5)
    assert (db[:99] < -50).all()


def test_the_choroid_has_vessels_and_ends_at_the_sclera():
    _, db = decibels(
        {"choroid_db": 15, "choroid_db_per_mm": 0, "lumen_db": -10, "sclera_db": 5, "choroid_mm": 0.2}
    )
    choroid, sclera = db[245:270], db[340:]
    assert choroid.min() == pytest.approx(5, abs=0.5) and choroid.max() == pytest.approx(15, abs=0.5)
    assert np.median(sclera) == pytest.approx(20, abs=0.5)


def test_below_atrophy_the_choroid_is_brighter():
    tissue, db = decibels(
        {"choroid_db": 10, "choroid_db_per_mm": 0, "lumen_db": 0, "transmission_db": 6}, atrophy_mm=2
    )
    lost = tissue.profiles.atrophy > 0.95
    kept = tissue.profiles.atrophy < 0.05
    assert np.median(db[250:260, lost]) - np.median(db[250:260, kept]) == pytest.approx(6, abs=0.5)


def test_fluid_is_dark():
    tissue, db = decibels({"fluid_db": -3}, fluid_mm=0.15)
    at = int(tissue.profiles.fluid_mm.argmax())
    floor = 200 + COMPLEX_MM / AXIAL_MM
    assert db[round(floor - 0.08 / AXIAL_MM), at] == pytest.approx(-3, abs=0.1)
    assert db[round(floor - 0.01 / AXIAL_MM), at] > 20  # the RPE below it


def test_cysts_are_dark_and_foci_bright():
    _, db = decibels({"fluid_db": -3, "focus_db": 39}, cysts=5, cyst_mm=0.15, foci=4)
    retina = db[105:195]
    assert (retina <= -3).mean() > 0.002
    assert (retina == 39).any()
