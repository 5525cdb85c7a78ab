import csv

import msgspec
import pytest
import touch_comparison
from helpers import make_step
from msgspec.structs import replace
from paths import ROOT
from touch_comparison import (
    VARIATIONS,
    VariedMeans,
    results_table,
    span,
    touch_figure,
    traits_table,
    variations_table,
    varied_means,
    write_trials,
)
from touch_trials import (
    MEASURES,
    TouchTrial,
    by_seed,
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
    table = touch_comparison.tests_table([tests, tests])
    assert "| Mean theta | binary → continuous | -1.00 deg | -1.00 | 0.094 | 0 of 2 |" in table


def test_tables_give_the_range_over_seeds(rows):
    other = [replace(row, seed=2, theta_deg=row.theta_deg + 1) for row in rows]
    table = results_table([*rows, *other])
    assert "| Mean theta (deg) | 10.50 to 11.50 (SD 1.87) |" in table
    means = varied_means([*rows, *other], "as drawn")
    assert [(each.seed, each.condition) for each in means[:4]] == [
        (1, "no touch"),
        (1, "binary"),
        (1, "continuous"),
        (2, "no touch"),
    ]
    assert "| as drawn | 10.50 to 11.50 / 20.0 / 0.0 |" in variations_table(means)


def stored(name: str, kind: type) -> list:
    """Return what a table beside the page of the comparison stores."""
    with (ROOT / "docs/explanation" / f"{name}.csv").open(encoding="utf-8") as file:
        return [msgspec.convert(row, kind, strict=False) for row in csv.DictReader(file)]


def test_the_page_shows_the_stored_trials_of_five_seeds():
    page = (ROOT / "docs/explanation/simulated_comparison.md").read_text(encoding="utf-8")
    trials = stored("simulated_comparison", TouchTrial)
    assert sorted(by_seed(trials)) == list(touch_comparison.SEEDS)
    assert results_table(trials) in page
    assert variations_table(stored("simulated_comparison_variations", VariedMeans)) in page


@pytest.mark.slow
def test_the_page_shows_the_tests_of_the_stored_trials():
    page = (ROOT / "docs/explanation/simulated_comparison.md").read_text(encoding="utf-8")
    seeds = by_seed(stored("simulated_comparison", TouchTrial)).values()
    assert touch_comparison.tests_table([paired_tests(part) for part in seeds]) in page


def differences(measure: str, first: tuple[str, str], second: tuple[str, str]) -> list[float]:
    """Return the second minus the first mean, each by variation and condition, of every seed."""
    means = {
        (each.variation, each.condition, each.seed): getattr(each, measure)
        for each in stored("simulated_comparison_variations", VariedMeans)
    }
    return [means[*second, seed] - means[*first, seed] for seed in touch_comparison.SEEDS]


DRAWN, DIM, TURNING, HALF = (
    "as drawn",
    "visual angle SD and bias times 4",
    "four times the turning speed",
    "half the attention to haptic cues",
)


@pytest.mark.parametrize(
    ("sentence", "measure", "variation", "conditions", "digits"),
    [
        ("touch is {} s faster than binary touch", "completion_s", DIM, ("continuous", "binary"), 1),
        ("as drawn, it is {} s faster", "completion_s", DRAWN, ("continuous", "binary"), 1),
        ("continuous touch is {} s faster.", "completion_s", TURNING, ("continuous", "binary"), 1),
        ("pay {} s for binary touch", "completion_s", TURNING, ("no touch", "binary"), 1),
        ("touch instead of {} s. Theta", "completion_s", DRAWN, ("no touch", "binary"), 1),
        ("theta falls by {}° instead", "theta_deg", HALF, ("binary", "no touch"), 1),
        ("instead of {}°, for", "theta_deg", DRAWN, ("binary", "no touch"), 1),
        ("for {} s instead", "completion_s", HALF, ("no touch", "binary"), 1),
    ],
)
def test_sentences_hold_for_every_seed(sentence, measure, variation, conditions, digits):
    page = " ".join((ROOT / "docs/explanation/simulated_comparison.md").read_text(encoding="utf-8").split())
    first, second = ((variation, condition) for condition in conditions)
    assert sentence.format(span(differences(measure, first, second), digits)) in page


def test_the_pages_other_claims_hold_for_every_seed():
    binary, continuous = (DIM, "binary"), (DIM, "continuous")
    drawn = differences("completion_s", (DRAWN, "binary"), (DRAWN, "continuous"))
    assert all(
        dim < as_drawn
        for dim, as_drawn in zip(differences("completion_s", binary, continuous), drawn, strict=True)
    )
    assert all(-0.5 < each < 0.005 for each in differences("theta_deg", binary, continuous))
    steady = (DRAWN, "binary"), ("with hysteresis", "binary")
    assert max(map(abs, differences("theta_deg", *steady))) < 0.1
    assert max(map(abs, differences("completion_s", *steady))) < 1.2
    means = stored("simulated_comparison_variations", VariedMeans)
    plain, kept = (
        [each.changes_per_min for each in means if (each.variation, each.condition) == key] for key in steady
    )
    fewer = [100 * (1 - after / before) for before, after in zip(plain, kept, strict=True)]
    assert span(fewer, 0) == "21 to 51"


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
