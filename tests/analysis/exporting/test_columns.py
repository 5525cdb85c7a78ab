from datetime import UTC, datetime

import pytest
from helpers import scenario_at
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.analysis.exporting.columns import Row, RunTable, unit_of
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.messages import ForceSample, HandState, RobotSample
from haptigraph.scene.meanings import MEANINGS
from haptigraph.scene.relations import MEASURES


@pytest.fixture(scope="module")
def table(recording):
    return RunTable(recording, "P01/run")


@pytest.fixture(scope="module")
def rows(table):
    return list(table.rows())


def column(table, name):
    return next(column for column in table.columns if column.name == name)


def values(table, name, rows):
    return [column(table, name).value(row) for row in rows]


def test_every_column_has_one_name_a_meaning_and_the_unit_of_its_name(table):
    names = [each.name for each in table.columns]
    assert len(names) == len(set(names))
    assert all(each.meaning for each in table.columns)
    units = {
        name: column(table, name).unit for name in ("theta_deg", "stamp_ns", "time_s", "state", "robot_x_mm")
    }
    assert units == {"theta_deg": "deg", "stamp_ns": "ns", "time_s": "s", "state": "", "robot_x_mm": "mm"}
    assert unit_of("hand_force_x_n") == "N"


def test_a_measure_says_what_it_is_and_between_which_entities(table):
    assert set(MEANINGS) == set(MEASURES)
    meaning = (
        "angle between the shaft and the line trocar -> target, in the image (needle_line, retina_target)"
    )
    assert column(table, "theta_deg").meaning == meaning
    assert "negative beyond" in column(table, "distance_to_retina_mm").meaning


def test_every_measure_has_a_unit():
    assert {unit_of(name) for name in MEASURES} == {"mm", "µm", "deg", "%", "s"}


def test_kinds_are_those_of_the_values(table, rows):
    kinds = {"text": (str, datetime), "integer": int, "number": float, "texts": list}
    seen = 0
    for each in table.columns:
        found = [value for row in rows if (value := each.value(row)) is not None]
        assert all(isinstance(value, kinds[each.kind]) for value in found), each.name
        seen += bool(found)
    assert seen > 30


def test_values_are_those_of_the_steps(table, rows):
    steps = [row.step for row in rows]
    assert values(table, "step", rows) == list(range(len(steps)))
    assert values(table, "state", rows) == [step.conclusion.state for step in steps]
    assert values(table, "plays", rows) == [step.command.pattern.name for step in steps]
    assert values(table, "theta_deg", rows) == [step.graph.measures.get("theta_deg") for step in steps]
    lines = [step.observation.found.get("needle_line") for step in steps]
    assert values(table, "needle_line_end_y_mm", rows) == [line and line.end_mm[1] for line in lines]
    assert None in values(table, "theta_deg", rows)
    assert {True, False} == {"pulse" in name for name in values(table, "plays", rows)}
    assert set(values(table, "recording", rows)) == {"P01/run"}
    depths = [row.capture.truth and row.capture.truth.depth_mm for row in rows]
    assert values(table, "true_depth_mm", rows) == depths


def test_wall_clock_is_exact_to_the_microsecond(table, rows):
    utc = values(table, "utc", rows)
    offset_ns = table.reader.info.utc_offset_ns
    for stamp, row in zip(utc, rows, strict=True):
        since_1970 = stamp - datetime(1970, 1, 1, tzinfo=UTC)
        microseconds = (
            since_1970.days * 86_400_000_000 + since_1970.seconds * 1_000_000 + since_1970.microseconds
        )
        assert microseconds == (row.step.stamp_ns + offset_ns) // 1000


def test_of_samples_between_two_images_the_newest_counts(table, rows):
    robot = [RobotSample(stamp, (stamp, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0)) for stamp in (1, 2)]
    force = [ForceSample(stamp, (0.0, 0.0, 0.0), (0.0, stamp, 0.0), True) for stamp in (1, 2)]
    hand = HandState(True, 0.1, 0.2, 0.3, 0.4, 1.0, False, 0.0)
    capture = replace(rows[0].capture, robot=tuple(robot), force=tuple(force), hand=hand)
    row = Row(0, capture, rows[0].step, 0)
    expected = {
        "robot_x_mm": 2,
        "robot_rotation_w": 1.0,
        "hand_force_y_n": 2,
        "asked_across_mm": 0.4,
        "hand_along_mm": 0.1,
    }
    assert {name: column(table, name).value(row) for name in expected} == expected
    assert {column(table, name).value(rows[0]) for name in expected} == {None}


def test_without_truth_and_timing_their_columns_are_empty(table, rows):
    row = Row(0, replace(rows[0].capture, truth=None), replace(rows[0].step, timing=None), 0)
    names = [each.name for each in table.columns if each.group == "truth"]
    assert len(names) == 5
    assert {column(table, name).value(row) for name in (*names, "processed_ns", "reason_ns")} == {None}


def test_a_volume_has_three_coordinates(quick_volume, tmp_path):
    path = tmp_path / "volume.mcap"
    settings = (
        f"source.uri=phantom:{scenario_at(2, quick_volume, tmp_path)}",
        "run.procedure=subretinal_injection_4d",
        "run.realtime=false",
        f'recording.path="{path}"',
    )
    assemble.build(load_config(None, settings)).run()
    table = RunTable(path, "volume")
    rows = list(table.rows())
    tips = [row.step.observation.found.get("needle_tip") for row in rows]
    assert values(table, "needle_tip_z_mm", rows) == [tip and tip.z_mm for tip in tips]
    assert any(tip and tip.z_mm for tip in tips)


def test_no_recording_is_refused(tmp_path):
    with pytest.raises(BadInput):
        RunTable(tmp_path / "none.mcap", "none")
