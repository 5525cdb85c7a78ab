"""Registrations of B-scans: what they say, and one sentence for what makes no sense."""

import pytest
from helpers import refuse
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.errors import BadInput
from haptigraph.registration.camera import Registration
from haptigraph.registration.oct import ScanRegistration, load_registered, parse_registered

GOOD = """format = 1

[image]
width = 400
height = 300

[scale]
axial_mm_per_px = 0.0033
lateral_mm_per_px = 0.0078

[target]
depth_share = 0.5
"""


def test_it_says_the_scale_in_both_directions():
    registration = parse_registered(GOOD, "r.toml")
    assert isinstance(registration, ScanRegistration)
    assert registration.target_share == 0.5
    assert registration.anatomy == {}
    to_mm = registration.image.to_mm
    assert to_mm((199.5, 149.5)) == (0.0, 0.0)
    assert to_mm((299.5, 49.5)) == pytest.approx((0.78, 0.33))


@given(st.floats(0, 400), st.floats(0, 300), st.booleans())
def test_there_and_back_is_the_same_place(x, y, mirrored):
    text = GOOD.replace("height = 300", f"height = 300\nmirrored = {str(mirrored).lower()}")
    image = parse_registered(text, "r.toml").image
    assert image.to_px(image.to_mm((x, y))) == pytest.approx((x, y), abs=1e-6)


def test_an_eye_is_still_an_eye(registration_toml):
    assert isinstance(parse_registered(registration_toml, "r.toml"), Registration)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("axial_mm_per_px = 0.0033\n", "", "axial_mm_per_px"),
        ("lateral_mm_per_px = 0.0078\n", "", "lateral_mm_per_px"),
        ("axial_mm_per_px = 0.0033", "mm_per_px = 0.0033", "mm_per_px"),
        (
            "0.0033",
            "3.3",
            "line 8: axial_mm_per_px of 3.3 is implausible; 0.0005 to 0.02 mm is what scanners have",
        ),
        ("0.0078", "0.0", "lateral_mm_per_px of 0 is implausible"),
        ("width = 400", "width = 20", "a width of 20 px; B-scans have at least 64"),
        (
            "depth_share = 0.5",
            "depth_share = 1.2",
            "depth_share must lie between 0 (ILM) and 1 (RPE), found 1.2",
        ),
        ("format = 1", "format = 7", "format 7 is not known"),
    ],
)
def test_a_bad_one_is_told_with_its_place(tmp_path, old, new, told):
    file = tmp_path / "scale.toml"
    file.write_text(GOOD.replace(old, new))
    with pytest.raises(BadInput) as refused:
        load_registered(file)
    assert told in str(refused.value)
    assert str(file) in str(refused.value)


def test_a_perceiver_that_is_made_for_other_images_says_so(quick_uri, quick_scan, tmp_path):
    told = refuse("run", quick_uri, "--fast", "--set", "perception.perceiver=bscan")
    assert "perceiver bscan needs the scale of B-scans" in told
    told = refuse("run", f"phantom:{quick_scan}", "--fast")
    assert "this registration is the scale of B-scans; try --procedure subretinal_injection_ioct" in told
    told = refuse("run", f"phantom:{quick_scan}", "--fast", "--set", "source.target_mm=1.0")
    assert "source.target_mm is for eyes before a camera" in told


def test_a_run_without_a_scale_is_refused(quick_scan, tmp_path):
    file = tmp_path / "scale.toml"
    file.write_text(GOOD.replace("lateral_mm_per_px = 0.0078\n", ""))
    told = refuse(
        *("run", f"phantom:{quick_scan}", "--fast", "--procedure", "subretinal_injection_ioct"),
        *("--registration", file),
    )
    assert "lateral_mm_per_px" in told
    assert str(file) in told
