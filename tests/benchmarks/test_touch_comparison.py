import csv

import pytest
import touch_comparison
from helpers import make_step
from msgspec.structs import replace
from touch_comparison import (
    VARIATIONS,
    results_table,
    touch_figure,
    traits_table,
    write_trials,
)
from touch_trials import (
    MEASURES,
    TouchTrial,
    measure_trial,
    paired_tests,
    participant_values,
)

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.study.simulated.participant import TRAITS, draw_participant

S = 1_000_000_000
BLANK = TouchTrial(0, "no touch", 0, 1, "ground-truth", True, 8.0, 20.0, 0, 1.0, 0.5, 0.0, 0.0)


@pytest.fixture
def rows():
    made = []
    for number in range(6):
        for repetition in range(2):
            more = {"participant": number, "repetition": repetition}
            made.append(replace(BLANK, **more, theta_deg=8.0 + number))
            for name, theta_deg in (("binary", 5.0), ("continuous", 4.0)):
                change = 0.1 * number * repetition
                made.append(
                    replace(
                        BLANK, **more, condition=name, theta_deg=theta_deg + change, vibrating_s=3.0 + number
                    )
                )
    return made


def test_vibration_is_measured_within_the_run_only():
    measures = RunMeasures(started_ns=2 * S, ended_ns=8 * S, last=make_step(stamp_ns=9 * S))
    output = [(0, 0.0), (1 * S, 0.3), (3 * S, 0.5), (4 * S, 0.0), (7 * S, 1.0)]
    vibrating_s, per_min = measure_trial(measures, output, changes=3)
    assert vibrating_s == pytest.approx(2 + 1)  # from 2 to 4 s, from 7 to 8 s
    assert per_min == pytest.approx(3 / 0.1)


def test_a_run_that_never_began_has_no_vibration():
    assert measure_trial(RunMeasures(), [(0, 1.0)], 5) == (0.0, 0.0)


def test_each_participant_has_one_value(rows):
    assert participant_values(rows, "theta_deg", "binary") == pytest.approx(
        [5.0 + 0.05 * number for number in range(6)]
    )


def test_every_measure_is_tested_except_differences_by_construction(rows):
    tests = paired_tests(rows)
    pairs = {measure: [(t.first, t.second) for t in tests if t.measure == measure] for measure in MEASURES}
    assert pairs["theta_deg"] == [
        ("no touch", "binary"),
        ("no touch", "continuous"),
        ("binary", "continuous"),
    ]
    assert pairs["vibrating_s"] == [("binary", "continuous")]
    theta = next(t for t in tests if t.measure == "theta_deg")
    assert theta.effect == -1
    assert theta.holm_p == pytest.approx(3 * theta.result.p)
    assert "exact" in touch_comparison.tests_table(tests)


def test_trials_are_written_as_csv(rows, tmp_path):
    write_trials(rows, tmp_path / "trials.csv")
    with (tmp_path / "trials.csv").open() as file:
        read = list(csv.DictReader(file))
    assert len(read) == len(rows)
    assert read[1] == {name: str(getattr(rows[1], name)) for name in read[1]} | {"hit": "1"}


def test_tables_and_figure_are_marked_as_simulated(rows, tmp_path):
    touch_figure(rows, tmp_path / "touch.svg")
    assert "Simulated operators, not people" in (tmp_path / "touch.svg").read_text()
    assert results_table(rows).startswith("| simulated operators |")
    assert (tmp_path / "touch.svg").stat().st_size > 10_000
    assert all(f"`{name}`" in traits_table() for name in TRAITS)


def test_the_perceiver_of_old_trials_is_named_in_the_figure(rows, tmp_path):
    touch_figure([replace(row, perceiver="known") for row in rows], tmp_path / "touch.svg")
    assert "perception: ground truth with the tracker" in (tmp_path / "touch.svg").read_text()


def test_variations_modify_participants():
    participant = draw_participant(1, 2)
    assert VARIATIONS[0](participant) == participant
    assert all(variation(participant) != participant for variation in VARIATIONS[1:])
    assert VARIATIONS[1](participant).visual_bias_sd_deg == 4 * participant.visual_bias_sd_deg
