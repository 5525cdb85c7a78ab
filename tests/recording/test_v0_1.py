"""A recording of version 0.1.0, in format 1, can be used like a current one."""

import csv

import pytest
from paths import DATA

from haptigraph.analysis.metrics.export import run_csv
from haptigraph.analysis.metrics.moment import explain_moment
from haptigraph.analysis.metrics.replay import replay
from haptigraph.recording.journal import complete_records
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import recover

RUN = DATA / "v0_1" / "run.mcap"
STEPS = 117


@pytest.fixture
def interrupted(tmp_path):
    """The same run, cut in the middle."""
    path = tmp_path / "interrupted.mcap"
    path.write_bytes(RUN.read_bytes()[: RUN.stat().st_size // 2])
    return path


def test_it_opens_and_its_uncertainties_have_their_current_names():
    reader = RunReader(RUN)
    assert (reader.info.format, reader.info.version, reader.is_whole) == ("1", "0.1.0", True)
    assert reader.count() == (STEPS, 0)
    stored = b"".join(record.data for _, record in complete_records(RUN) if hasattr(record, "sequence"))
    assert b'"tip_deviation_mm":' in stored and b'"theta_deviation_deg":' in stored
    certain = [
        step.observation.certainty for _, step in reader.records(images=()) if step.observation.certainty
    ]
    assert len(certain) > 50
    assert all(0 < each.tip_sd_mm < 1 and 0 < each.theta_sd_deg < 10 for each in certain)


def test_it_replays_with_this_version_of_perception():
    report = replay(RUN)
    assert report.steps == STEPS
    assert report.first and report.first.message == "observation"


def test_it_is_explained():
    explanation = explain_moment(RUN, 3.0)
    assert explanation.state == next(
        step.conclusion.state for _, step in RunReader(RUN).records(images=()) if step.stamp_ns >= 3 * 10**9
    )
    assert explanation.runner_up is not None


def test_it_is_exported(tmp_path):
    run_csv(RUN, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open() as file:
        rows = list(csv.DictReader(file))
    states = [step.conclusion.state for _, step in RunReader(RUN).records(images=())]
    assert [row["state"] for row in rows] == states


def test_it_is_recovered_in_its_format(interrupted):
    before = [step for _, step in RunReader(interrupted).records(images=())]
    assert 10 < len(before) < STEPS
    assert not RunReader(interrupted).is_whole
    assert recover(interrupted)
    reader = RunReader(interrupted)
    assert (reader.is_whole, reader.info.format) == (True, "1")
    assert [step for _, step in reader.records(images=())] == before
    report = replay(interrupted)
    assert report.steps == len(before)
    assert report.first and report.first.message == "observation"
