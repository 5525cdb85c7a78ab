"""Thresholds that no eye allows are refused where somebody edits the file, and warned of where nobody does."""

import warnings

import pytest
from helpers import call, refuse

from haptigraph.assemble import load_procedure, parse_procedure, procedure_names
from haptigraph.errors import BadInput, Implausible
from haptigraph.inference.plausible import NEAR_MM
from haptigraph.registration.camera import DIAMETER_RANGE_MM
from haptigraph.scene.relations import MEASURES, SMALLEST_EYE_MM

TEXT = load_procedure("subretinal_injection").text
IN_UM = TEXT.replace("0.7\n", "700\n").replace("5.5\n", "5500\n")


@pytest.fixture
def file(tmp_path):
    return tmp_path / "mine.toml"


def test_the_smallest_eye_is_that_of_registrations():
    assert DIAMETER_RANGE_MM[0] == SMALLEST_EYE_MM
    assert SMALLEST_EYE_MM / 4 == NEAR_MM == MEASURES["wall_mm"].plausible.high


@pytest.mark.parametrize("name", MEASURES)
def test_plausible_thresholds_are_within_the_geometric_limits(name):
    plausible = MEASURES[name].plausible
    assert plausible.low < plausible.high and 0 < plausible.resolution < plausible.high
    for limits in MEASURES[name].shapes.values():
        assert limits.lower <= plausible.low or name in ("distance_mm",)
        assert plausible.high <= limits.upper


def test_micrometres_read_as_millimetres_are_refused_by_check_and_run(file):
    file.write_text(IN_UM)
    for command in (["check", file], ["run", "phantom:quick", "--procedure", file]):
        assert "at_most = 700 mm separates nothing" in refuse(*command)


def test_a_reason_is_accepted_and_repeated(file):
    file.write_text(TEXT.replace("at_most = 1.7", 'at_most = 1.7\nreason = "as published"'))
    result = call("check", file)
    assert result.exit_code == 0
    assert "no eye seems to allow: as published" in result.output


def test_a_pattern_may_follow_a_measure_as_far_as_a_relation_with_a_reason_goes(file):
    text = load_procedure("subretinal_injection_continuous").text
    far = text.replace("start = [5.5, 1.5]", "start = [40.0, 1.5]")
    assert far != text
    file.write_text(far)
    with pytest.raises(BadInput, match="near follows distance_to_retina_mm: 40 mm separates nothing"):
        load_procedure(str(file))
    file.write_text(far.replace("at_most = 5.5\n", 'at_most = 5.5\nreason = "a bowl of 60 mm"\n', 1))
    load_procedure(str(file))


def test_an_empty_reason_is_refused(file):
    file.write_text(TEXT.replace("at_most = 1.7", 'at_most = 1.7\nreason = " "'))
    with pytest.raises(BadInput, match="reason is empty"):
        load_procedure(str(file))


def test_a_text_that_nobody_edits_opens_with_one_warning():
    with pytest.warns(Implausible, match=r"at_most = 700 mm.*5 more like it") as caught:
        procedure = parse_procedure(IN_UM, "procedure in old.mcap")
    assert len(caught) == 1
    assert procedure.schema.relations[0].at_most == 700


def test_nothing_is_said_of_shipped_procedures():
    with warnings.catch_warnings(action="error"):
        for name in procedure_names():
            load_procedure(name)


def test_zero_is_always_plausible(file):
    file.write_text(TEXT.replace("0.7\n", "0.0\n"))
    assert load_procedure(str(file)).schema.relations[0].at_most == 0
