"""A registration that assumes its target: marked everywhere, and nothing vibrates without consent."""

import csv
import json
from pathlib import Path

import pytest
from helpers import call, refuse
from paths import RENDERINGS

from haptigraph.recording.reader import RunReader
from haptigraph.registration.loading import load_registration, parse_registration

pytestmark = pytest.mark.usefixtures("anatomy_once")


@pytest.fixture(scope="module")
def folder(sparse_uri, tmp_path_factory) -> Path:
    """`assumed.toml` and `stated.toml`, and a recording with the former."""
    folder = tmp_path_factory.mktemp("assumed")
    report = call("register", sparse_uri, "-o", folder / "assumed.toml", "--images", "12").stdout
    (folder / "report.txt").write_text(report)
    call(
        "register",
        sparse_uri,
        "-o",
        folder / "stated.toml",
        "--target-mm",
        "1.9",
        "--diameter-mm",
        "24",
        "--mirrored",
        "--images",
        "12",
    )
    run = call(
        "run",
        sparse_uri,
        "--fast",
        "--registration",
        folder / "assumed.toml",
        "--record",
        folder / "run.mcap",
    )
    (folder / "run.txt").write_text(run.output)
    return folder


def amplitudes(uri: str, registration: Path, trace: Path, *more: str) -> tuple[set[float], str]:
    run = call("run", uri, "--fast", "--registration", registration, "--device", f"trace:{trace}", *more)
    assert run.exit_code == 0, run.output
    with trace.open() as file:
        return {float(row["amplitude"]) for row in csv.DictReader(file)}, run.stderr


def test_register_marks_what_it_assumed(folder):
    assert load_registration(folder / "assumed.toml").assumed[:3] == ("target", "scale", "mirror")
    report = (folder / "report.txt").read_text()
    assert "(assumed: its lowest point)" in report
    assert "ASSUMED    the target, the scale and the mirroring of the image" in report
    assert "--target or --target-mm, --diameter-mm, --[not-]mirrored" in report


def test_register_marks_nothing_that_was_stated(folder):
    assert not {"target", "scale", "mirror"} & set(load_registration(folder / "stated.toml").assumed)


def test_nothing_vibrates_for_an_assumed_target(folder, sparse_uri, tmp_path):
    felt, log = amplitudes(sparse_uri, folder / "assumed.toml", tmp_path / "touch.csv")
    assert felt <= {0.0}
    assert "assumed, not measured: the target" in log and "haptic output is off" in log
    assert log.index("haptic output is off") < log.index("0.00 s")


def test_the_user_may_accept_it(folder, sparse_uri, tmp_path):
    felt, log = amplitudes(sparse_uri, folder / "assumed.toml", tmp_path / "touch.csv", "--accept-assumed")
    assert max(felt) == 1.0
    assert "assumed, not measured: the target" in log and "haptic output is on (--accept-assumed)" in log


def test_a_stated_target_needs_no_consent(folder, sparse_uri, tmp_path):
    felt, log = amplitudes(sparse_uri, folder / "stated.toml", tmp_path / "touch.csv")
    assert max(felt) == 1.0
    assert "the target" not in log.partition("0.00 s")[0]


def test_a_target_stated_by_a_setting_needs_no_consent(folder, sparse_uri, tmp_path):
    felt, _ = amplitudes(
        sparse_uri, folder / "assumed.toml", tmp_path / "touch.csv", "--set", "source.target_mm=1.9"
    )
    assert max(felt) == 1.0


def test_recording_replay_and_reports_mark_it(folder):
    info = RunReader(folder / "run.mcap").info
    assert parse_registration(info.registration, "recorded").assumed[0] == "target"
    assert json.loads(info.config)["haptics"]["max_amplitude"] == 0.0
    assert "haptic output   off: claims are about what was commanded" in (folder / "run.txt").read_text()
    line = "assumed         the target, the scale"
    assert line in (folder / "run.txt").read_text()
    assert line in call("replay", folder / "run.mcap").stdout
    assert "assumed    the target, the scale" in call("explain", folder / "run.mcap", "--at", "1").stdout


def test_evaluate_marks_it(tmp_path):
    clip = RENDERINGS / "golden_thin"
    for name in ("clip.mp4", "truth.csv"):
        (tmp_path / name).symlink_to((clip / name).resolve())
    text = (clip / "registration.toml").read_text()
    (tmp_path / "registration.toml").write_text(
        text.replace("format = 1\n", 'format = 1\nassumed = ["target"]\n', 1)
    )
    scores = json.loads(call("evaluate", tmp_path, "--json").stdout)
    assert scores["assumed"] == ["target"]


def test_a_study_refuses_assumed_positions(folder, sparse_uri, tmp_path):
    pytest.importorskip("sqlalchemy")
    call("study", "new", tmp_path / "study")
    text = (folder / "assumed.toml").read_text().replace('assumed = ["target"', 'assumed = ["trocar"')
    (tmp_path / "eye.toml").write_text(text)
    line = refuse(
        "study", "run", tmp_path / "study", "--source", sparse_uri, "--registration", tmp_path / "eye.toml"
    )
    assert "eye.toml: assumes the trocar" in line and "a study needs measured positions" in line
