"""A run with a profile: the device gets drives, steps keep amplitudes, the recording has the profile."""

import csv
import hashlib

import pytest
from helpers import call, refuse
from made_profiles import TEXT

from haptigraph.haptics.profiles.profile import parse_profile
from haptigraph.recording.reader import RunReader


@pytest.fixture
def profile_file(tmp_path):
    path = tmp_path / "pad.toml"
    path.write_text(TEXT)
    return path


def test_the_device_gets_the_drive_and_the_recording_says_why(profile_file, quick_uri, tmp_path):
    trace, run = tmp_path / "touch.csv", tmp_path / "run.mcap"
    arguments = ("run", quick_uri, "--fast", "--device", f"trace:{trace}", "--profile", profile_file)
    result = call(*arguments, "--record", run)
    assert result.exit_code == 0, result.output
    assert "by the profile of gamepad:0 (answers: P01, 2026-11-26)" in result.stderr
    assert "pulse: amplitude 1 is felt as 0.8" in result.stderr
    reader, profile = RunReader(run), parse_profile(TEXT, "p.toml")
    assert reader.info.device_profile == TEXT
    assert reader.info.device_profile_sha256 == hashlib.sha256(TEXT.encode()).hexdigest()
    commanded = {step.command.pattern.amplitude for _, step in reader.records()} - {0.0}
    with trace.open() as file:
        driven = {float(row["amplitude"]) for row in csv.DictReader(file)} - {0.0}
    assert driven and driven <= {profile.drive_at(each) for each in commanded}
    assert profile.drive_at(0.3) in driven and 0.3 not in driven
    replayed = call("replay", run)
    assert replayed.exit_code == 0
    digest = reader.info.device_profile_sha256[:12]
    assert f"the device played amplitudes by its profile, sha256 {digest}" in replayed.stdout


@pytest.mark.parametrize(
    ("device", "edit", "sentence"),
    [
        ("audio:touch.wav", lambda text: text[:300], "pad.toml"),
        ("audio", lambda text: text, "pad.toml: is the profile of gamepad:0, not of audio"),
        (
            "console",
            lambda text: text.replace("intensity = 0.8", "intensity = 0.3"),
            "expected both to increase",
        ),
    ],
)
def test_a_profile_that_is_damaged_or_of_another_device_starts_no_run(
    profile_file, quick_uri, device, edit, sentence, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    profile_file.write_text(edit(TEXT))
    run = tmp_path / "run.mcap"
    assert sentence in refuse(
        "run", quick_uri, "--device", device, "--profile", profile_file, "--record", run
    )
    assert {path.name for path in tmp_path.iterdir()} == {"pad.toml"}


def test_check_takes_the_device_from_the_profile(profile_file):
    checked = call("check", "--profile", profile_file)
    assert checked.exit_code == 1
    assert "gamepad gives every pattern as strong as meant" in checked.stdout
    assert "pulse: amplitude 1 is felt as 0.8" in checked.stdout
    assert "is the profile of gamepad:0, not of serial" in refuse(
        "check", "--profile", profile_file, "--device", "serial:x"
    )
