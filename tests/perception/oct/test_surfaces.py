"""ILM and RPE below the tip of a needle, where what is visible ends, and specks."""

import numpy as np
import pytest
from scans.bscans import perceiver_of

from haptigraph.geometry import height_on_polyline
from haptigraph.messages import Capture
from haptigraph.perception.oct.surfaces import without_specks
from haptigraph.sim.oct.scenes import random_scene


@pytest.fixture(scope="module")
def tilted():
    """Errors of both surfaces below the tip on a tilted retina, by name [mm]."""
    errors_mm = {"ilm": [], "rpe": []}
    for number in range(16):
        scene = random_scene(number, 613, place="above", tilt_deg=12.0)
        perceive, image = perceiver_of(scene)
        scan = scene.take()
        found = perceive(Capture(0, 0, scan.image)).found
        x_px, _ = scan.truth.needle.tip_px
        for name in errors_mm.keys() & found.keys():
            rows = getattr(scan.truth, f"{name}_px")
            x_mm, true_mm = image.to_mm((x_px, np.interp(x_px, np.arange(len(rows)), rows)))
            errors_mm[name].append(abs(height_on_polyline(x_mm, found[name]) - true_mm))
    return errors_mm


@pytest.mark.parametrize(("name", "most_mm"), [("ilm", 0.005), ("rpe", 0.008)])
def test_below_the_tip_a_tilted_surface_is_as_exact_as_a_level_one(tilted, name, most_mm):
    assert len(tilted[name]) >= 12
    assert np.median(tilted[name]) <= most_mm


@pytest.mark.parametrize(
    ("mask", "kept"),
    [
        ("0001111100", "0000000000"),
        ("0001111110", "0001111110"),
        ("1110000000", "1110000000"),
        ("0000000011", "0000000000"),
        ("1111110011100000", "1111110011100000"),
        ("0000111001111110", "0000111001111110"),
        ("1111110001110000", "1111110000000000"),
        ("1111110011000000", "1111110000000000"),
        ("0011100111000000", "0000000000000000"),
    ],
)
def test_a_short_part_stays_at_the_border_and_beside_a_long_part_behind_a_narrow_gap(mask, kept):
    assert without_specks(np.array(list(mask)) == "1").tolist() == [one == "1" for one in kept]
