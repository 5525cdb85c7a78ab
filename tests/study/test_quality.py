"""Thresholds of data quality: what is beyond them, what cannot be judged, and their place in the protocol."""

import math
from importlib import resources

import pytest
from hypothesis import given
from hypothesis import strategies as st
from protocols import SMALL

from haptigraph.study.data_dictionary import MEASURES
from haptigraph.study.frozen.quality import RULES, Quality, is_unrecorded, quality_limits, quality_problems
from haptigraph.study.protocol import load_protocol

GOOD = {"images_per_s": 30.0, "late_images_fraction": 0.0, "unseen_fraction": 0.1, "longest_gap_s": 0.3}
ALL = Quality(min_images_per_s=20, max_late_fraction=0.05, max_unseen_fraction=0.2, max_gap_s=0.5)


def test_each_threshold_flags_its_measure_and_nothing_else():
    assert quality_problems(GOOD, ALL) == [] and not is_unrecorded(GOOD, ALL)
    for measure, value, problem in (
        ("images_per_s", 9.04, "9.04 images/s (at least 20)"),
        ("late_images_fraction", 0.125, "12.5 % late images (at most 5)"),
        ("unseen_fraction", 0.5, "50 % of the time without a visible tip (at most 20)"),
        ("longest_gap_s", 2.25, "2.25 s in a row without a visible tip (at most 0.5)"),
    ):
        assert quality_problems({**GOOD, measure: value}, ALL) == [problem]
        assert quality_problems({**GOOD, measure: value}, Quality()) == []
    assert quality_limits(ALL)[0] == "at least 20 images/s" and len(quality_limits(ALL)) == len(RULES)
    assert quality_limits(Quality()) == []


@given(st.sampled_from(RULES), st.floats(0.001, 1), st.floats(0, 1))
def test_a_value_at_the_threshold_is_allowed(rule, limit, value):
    thresholds = Quality(**{rule.key: limit})
    is_beyond = value < limit if rule.key.startswith("min_") else value > limit
    assert bool(quality_problems({rule.measure: value}, thresholds)) == is_beyond


@pytest.mark.parametrize("missing", [None, math.nan])
def test_what_was_not_recorded_is_not_judged_and_said_to_be_so(missing):
    row = {**GOOD, "longest_gap_s": missing}
    assert quality_problems(row, ALL) == [] and is_unrecorded(row, ALL)
    assert is_unrecorded({}, ALL) and not is_unrecorded({}, Quality())
    assert not is_unrecorded(row, Quality(min_images_per_s=20))


def test_every_threshold_is_about_a_measure_of_the_dictionary():
    assert {rule.measure for rule in RULES} <= {field.name for field in MEASURES}
    assert [rule.key for rule in RULES] == list(Quality.__struct_fields__)


def test_a_protocol_has_no_thresholds_unless_it_sets_them(folder, protocol):
    assert protocol.quality == Quality()
    (folder / "study.toml").write_text(SMALL + "\n[quality]\nmax_gap_s = 2\n")
    assert load_protocol(folder).quality == Quality(max_gap_s=2.0)


def test_the_template_sets_every_threshold(folder):
    template = resources.files("haptigraph.study").joinpath("templates/study.toml").read_text("utf-8")
    (folder / "study.toml").write_text(template)
    assert len(quality_limits(load_protocol(folder).quality)) == len(RULES)
