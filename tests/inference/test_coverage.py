"""What no claim covers is said, and what the perceiver of a run cannot report."""

import pytest
from helpers import call
from msgspec.structs import replace
from paths import DATA

from haptigraph.assemble import PERCEIVERS, load_procedure, perceiver_class, procedure_names
from haptigraph.inference.coverage import (
    CAMERA_ANATOMY,
    reported_with,
    uncovered,
    unreported,
    unreported_notes,
)
from haptigraph.registration.loading import parse_registration
from haptigraph.sources.phantom import PhantomSource

BEYOND = "how far beyond retina_surface target_hit may be: distances there are negative"


def test_the_anatomy_of_a_camera_is_that_of_its_registration():
    registration = parse_registration(PhantomSource("wrong_place_then_hit").registration, "x")
    assert registration.anatomy.keys() == CAMERA_ANATOMY


def test_a_procedure_without_claims_is_told_so(procedure):
    bare = replace(procedure, invariants=(), temporal=())
    assert uncovered(bare) == [
        "what the states mean to the surgeon: there is no [[invariant]]",
        "how soon an alarm is felt: there is no [[temporal]] claim with within_ms",
        BEYOND,
    ]


def test_only_how_deep_success_may_be_is_uncovered_in_the_paper_s_procedure(procedure):
    assert uncovered(procedure) == [BEYOND]


def test_an_alarm_of_which_nobody_says_when_it_is_felt_is_named(procedure):
    invariants = tuple(one for one in procedure.invariants if "pulse" not in one.feels)
    phrases = uncovered(replace(procedure, invariants=invariants, temporal=()))
    assert phrases[0].startswith("retinal_contact, an alarm: no [[invariant]]")


def test_kinds_that_are_assumed_are_named(procedure):
    states = tuple(replace(one, kind=None) if one.name == "outside_eye" else one for one in procedure.states)
    assert uncovered(replace(procedure, states=states)) == [
        "the kinds of states that do not say it, which are assumed: outside_eye neutral",
        BEYOND,
    ]


def test_without_an_alarm_nothing_tells_the_hand_to_stop(procedure):
    states = tuple(replace(one, kind="guidance") if one.kind == "alarm" else one for one in procedure.states)
    assert uncovered(replace(procedure, states=states))[0].startswith("a signal to stop")


@pytest.mark.parametrize("name", procedure_names())
def test_the_perceiver_that_a_run_would_choose_reports_what_a_shipped_procedure_needs(name):
    assert "cannot occur" not in call("check", name).output


def test_forceps_do_not_report_a_needle(procedure):
    missing = unreported(procedure, reported_with(perceiver_class("forceps")))
    assert missing["retinal_contact"] == ("needle_tip",)
    assert missing["misaligned_retinal_approach"] == ("needle_tip", "needle_line")
    assert "unknown" not in missing


def test_an_entity_that_only_a_given_needs_counts(procedure):
    everything = {entity.name for entity in procedure.schema.entities}
    assert unreported(procedure, everything - {"retina_surface"})["target_hit"] == ("retina_surface",)


def test_phases_are_reported_by_the_run():
    procedure = load_procedure("subretinal_injection_phases")
    assert unreported(procedure, reported_with(perceiver_class("tracker"))) == {}


def test_a_note_names_the_alarm_that_can_never_be_felt(procedure):
    (note,) = unreported_notes(procedure, "forceps", perceiver_class)
    assert "perceiver forceps reports no needle_tip" in note
    assert note.endswith("THE ALARM retinal_contact CAN NEVER BE FELT")
    assert unreported_notes(procedure, "tracker", perceiver_class) == []


def test_a_run_says_so_before_it_starts():
    source = f"phantom:{DATA / 'quick.toml'}"
    result = call("run", source, "--fast", "--set", "perception.perceiver=forceps")
    assert "CAN NEVER BE FELT" in result.output


@pytest.mark.parametrize("name", PERCEIVERS)
def test_every_perceiver_says_what_it_reports(name):
    assert reported_with(perceiver_class(name))
