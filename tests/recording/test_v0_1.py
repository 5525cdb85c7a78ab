"""A recording of version 0.1.0, in format 1, can be used like a current one."""

import csv

import pytest
from helpers import mostly_slow
from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import Writer
from paths import DATA

from haptigraph.analysis.exporting.csv_table import run_csv
from haptigraph.analysis.metrics.moment import explain_moment
from haptigraph.analysis.metrics.replay import replay
from haptigraph.errors import BadInput
from haptigraph.recording.journal import complete_records
from haptigraph.recording.reader import RunReader
from haptigraph.recording.recovery import recover

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


def test_what_is_left_of_a_cut_file_is_saved_in_its_format(interrupted):
    data = interrupted.read_bytes()
    before = [step for _, step in RunReader(interrupted).records(images=())]
    assert 10 < len(before) < STEPS
    assert not RunReader(interrupted).is_whole
    recovery = recover(interrupted)
    assert (recovery.is_lossless, recovery.steps) == (False, len(before))
    assert interrupted.read_bytes() == data
    reader = RunReader(recovery.saved)
    assert (reader.is_whole, reader.info.format) == (True, "1")
    assert [step for _, step in reader.records(images=())] == before
    report = replay(recovery.saved)
    assert report.steps == len(before)
    assert report.losses is not None
    assert report.first and report.first.message == "observation"


@pytest.fixture
def journal(tmp_path):
    """The same run as an interrupted journal of format 1: records without chunks."""
    path = tmp_path / "journal.mcap"
    ids = {}
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start(library="haptigraph 0.1.0")
        for _, record in complete_records(RUN):
            if isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
            elif isinstance(record, Schema):
                ids[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel):
                writer.register_channel(record.topic, record.message_encoding, ids[record.schema_id])
            elif isinstance(record, Message):
                message = (
                    record.channel_id,
                    record.log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
                writer.add_message(*message)
    return path


def test_an_interrupted_journal_is_completed_and_its_lack_of_checksums_reported(journal):
    steps = [step for _, step in RunReader(journal).records(images=())]
    assert len(steps) == STEPS
    recovery = recover(journal)
    assert (recovery.saved, recovery.steps, recovery.is_verified) == (journal, STEPS, False)
    assert [step for _, step in RunReader(journal).records(images=())] == steps
    assert recover(journal).saved is None


@pytest.mark.parametrize("bit", mostly_slow([1, 2, 4, 8, 16, 32, 64, 128], 1, 128))
def test_a_changed_length_in_a_journal_without_checksums_costs_one_step(journal, bit):
    data = bytearray(journal.read_bytes())
    start = [end for end, record in complete_records(journal) if isinstance(record, Message)][99]
    data[start + 2] ^= bit
    journal.write_bytes(data)
    with pytest.raises(BadInput, match=r"damaged \(|cannot be read"):
        RunReader(journal).count()
    recovery = recover(journal)
    assert (recovery.steps, len(recovery.missing), recovery.is_lossless) == (STEPS - 1, 1, False)
    assert journal.read_bytes() == data
    assert RunReader(recovery.saved).count() == (STEPS - 1, 0)


def test_a_changed_digit_of_its_procedure_is_noticed(tmp_path):
    data = RUN.read_bytes()
    path = tmp_path / "changed.mcap"
    path.write_bytes(data.replace(b"at_most = 5.5", b"at_most = 9.5", 1))
    assert path.read_bytes() != data
    with pytest.raises(BadInput, match="header is damaged \\(the SHA-256 of its procedure differs"):
        RunReader(path)
