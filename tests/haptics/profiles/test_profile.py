"""Device profiles: the file, and the mapping from perceived intensity to drive."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_profiles import TEXT, profiles
from msgspec.structs import replace

import haptigraph
from haptigraph.config import HapticsConfig
from haptigraph.errors import BadInput
from haptigraph.haptics.profiles.profile import load_profile, open_profile, parse_profile
from haptigraph.haptics.profiles.writing import profile_text
from haptigraph.messages import Capabilities

EXAMPLES = Path(haptigraph.__file__).parents[1] / "examples" / "profiles"


@given(profiles(), st.floats(0, 1))
def test_whatever_vibrates_is_driven_above_the_threshold_and_never_beyond_what_was_measured(
    profile, intensity
):
    drive = profile.drive_at(intensity)
    if not intensity:
        assert drive == 0
        return
    assert profile.threshold.drive <= drive <= profile.intensity.point[-1].drive <= 1


@given(profiles(), st.floats(0, 1), st.floats(0, 1))
def test_the_order_of_intensities_is_the_order_of_drives(profile, one, other):
    low, high = sorted((one, other))
    assert profile.drive_at(low) <= profile.drive_at(high)


@given(profiles(), st.floats(0.01, 1))
def test_the_mapping_is_invertible_up_to_the_strongest(profile, share):
    intensity = share * profile.strongest
    assert profile.intensity_at(profile.drive_at(intensity)) == pytest.approx(intensity, rel=1e-6, abs=1e-9)
    assert profile.intensity_at(profile.threshold.drive) == 0
    assert 0 <= profile.sd_at(intensity) <= 1


def test_points_are_met_and_a_power_law_between_them_is_exact():
    profile = parse_profile(TEXT, "p.toml")
    assert [profile.drive_at(each) for each in (0.2, 0.5, 0.8, 1.0)] == pytest.approx([0.3, 0.6, 1, 1])
    assert profile.drive_at((0.2 * 0.5) ** 0.5) == pytest.approx((0.3 * 0.6) ** 0.5)
    assert profile.drive_at(0.1) == pytest.approx(0.2)  # half-way from the threshold to the first point
    assert profile.sd_at(0.5) == pytest.approx(0.04)


def test_the_measured_onset_replaces_that_of_the_class():
    profile, pad = parse_profile(TEXT, "p.toml"), Capabilities(100, None, 50.0, max_rate_hz=20.0)
    assert profile.applied_to(pad) == replace(pad, shortest_on_ms=62.0)
    assert replace(profile, onset=None).applied_to(pad) == pad


def test_a_profile_that_was_written_reads_the_same():
    profile = parse_profile(TEXT, "p.toml")
    assert parse_profile(profile_text(profile), "p.toml") == profile


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("format = 1", "format = 2", "format: "),
        ("drive = 0.6", "drive = 0.2", "line 29: drive 0.3 feels 0.2, drive 0.2 feels 0.5; expected both to increase"),
        ("intensity = 0.8", "intensity = 0.5", "drive 0.6 feels 0.5, drive 1 feels 0.5; expected both to increase"),
        ("sd = 0.04", "sd = 0", "intensity 0.5 is stated without uncertainty; give an sd above 0"),
        ("intensity = 0.8", "intensity = 1.2", "found 1.2"),
        ("drive = 1.0", "drive = 3.0", "found 3.0"),
        ("drive = 1.0", "drive = nan", "nan"),
        ("drive = 0.3", "drive = 0.1", "drive 0.1 is felt, but the threshold is 0.1; a point lies above it"),
        ("high = 0.12", "high = 0.09", "found 0.1 with an interval of 0.08 to 0.09; the interval must contain it"),
        ("low_ms = 55.0\nhigh_ms = 70.0", "low_ms = 62.0\nhigh_ms = 62.0", "the interval must contain it and have a width"),
        ('basis = "measured"', 'basis = "certain"', "basis"),
        ('by = "P01"\n', "", "key 'by' is missing"),
        ("[onset]", "[onsets]", "onsets"),
    ],
)  # fmt: skip
def test_what_is_damaged_or_claims_too_much_is_refused_in_one_sentence(old, new, sentence):
    assert old in TEXT
    with pytest.raises(BadInput) as error:
        parse_profile(TEXT.replace(old, new, 1), "p.toml")
    assert str(error.value).startswith("p.toml") and sentence in str(error.value)


def test_one_point_is_too_few():
    text = TEXT[: TEXT.index("[[intensity.point]]\ndrive = 0.6")]
    with pytest.raises(BadInput, match="expected two points or more, found 1"):
        parse_profile(text, "p.toml")


def test_only_the_unit_of_a_scale_of_its_own_needs_no_uncertainty():
    text = TEXT.replace('"audio"', '"own"').replace("intensity = 0.8\nsd = 0.08", "intensity = 1.0\nsd = 0")
    assert parse_profile(text, "p.toml").strongest == 1
    with pytest.raises(BadInput, match="without uncertainty"):
        parse_profile(text.replace('"own"', '"audio"'), "p.toml")


def test_a_profile_belongs_to_its_kind_of_device_and_can_be_rehearsed_without_one(tmp_path):
    path = tmp_path / "pad.toml"
    path.write_text(TEXT)
    assert open_profile(HapticsConfig()) == (None, "")
    for device in ("gamepad:0", "gamepad:1", "console", "trace:touch.csv"):
        profile, text = open_profile(HapticsConfig(device=device, profile=str(path)))
        assert profile == load_profile(path) and text == TEXT
    with pytest.raises(BadInput, match="is the profile of gamepad:0, not of audio; measure one"):
        open_profile(HapticsConfig(device="audio", profile=str(path)))
    with pytest.raises(BadInput, match="cannot be read"):
        open_profile(HapticsConfig(profile=str(tmp_path / "none.toml")))


def test_the_profile_in_the_docs_is_valid():
    text = (EXAMPLES.parents[1] / "docs/how_to/devices.md").read_text()
    (block,) = (
        each for each in re.findall(r"```toml\n(.*?)```", text, re.DOTALL) if "[[intensity.point]]" in each
    )
    assert parse_profile(block, "devices.md").intensity.scale == "audio"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.name)
def test_shipped_examples_are_valid_and_claim_no_measurement(path):
    profile = load_profile(path)
    parts = [profile.threshold, profile.intensity, *([profile.onset] if profile.onset else [])]
    assert {part.basis for part in parts} <= {"literature", "judgement"}
