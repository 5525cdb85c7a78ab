"""Signs of states follow from their kind: no alarm has that of another state."""

import pytest

from haptigraph.assemble import load_procedure, parse_procedure, procedure_names
from haptigraph.dashboard.server.describe import describe_states


@pytest.mark.parametrize("name", procedure_names())
def test_the_sign_of_an_alarm_is_no_other_states(name):
    procedure = load_procedure(name)
    described = describe_states(procedure)
    assert [state["kind"] for state in described] == list(procedure.kinds.values())
    for state in described:
        assert (state["icon"] == "alarm") == (state["kind"] == "alarm")
        assert (state["icon"] in ("lost", "tipless", "unseen")) == (state["kind"] == "unseen")


def test_an_alarm_of_steady_vibration_has_the_sign_of_an_alarm(procedure):
    text = procedure.text.replace('feel = "pulse"', 'feel = "low"')
    described = {state["name"]: state for state in describe_states(parse_procedure(text, "steady.toml"))}
    assert described["retinal_contact"]["icon"] == "alarm"
    assert described["misaligned_retinal_approach"]["icon"] == "warn"


def test_a_state_has_the_colour_that_its_procedure_gives_it(procedure):
    text = procedure.text.replace('name = "outside_eye"', 'name = "outside_eye"\ncolor = "#102030"')
    described = {state["name"]: state for state in describe_states(parse_procedure(text, "own.toml"))}
    assert (described["outside_eye"]["color"], described["outside_eye"]["ink"]) == ("#102030", "#ffffff")
