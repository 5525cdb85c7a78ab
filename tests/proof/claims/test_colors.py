"""An alarm in the colour of a silent state violates a claim, with any colour vision."""

import pytest

from haptigraph.assemble import load_procedure, parse_procedure, procedure_names
from haptigraph.errors import BadInput
from haptigraph.proof.claims.colors import color_claims


def with_color(color: str, state: str = "retinal_contact"):
    text = load_procedure("subretinal_injection").text
    return parse_procedure(
        text.replace(f'name = "{state}"', f'name = "{state}"\ncolor = "{color}"'), "own.toml"
    )


@pytest.mark.parametrize("name", procedure_names())
def test_every_shipped_procedure_holds(name):
    (claim,) = color_claims(load_procedure(name))
    assert claim.holds


@pytest.mark.parametrize("color", ["#9cc5e8", "#efefef", "#2f6fb3", "#9fc6e5", "#b7a6cf", "#3a9d5d"])
def test_an_alarm_that_looks_like_a_silent_state_is_found(color):
    (claim,) = color_claims(with_color(color))
    assert f"the alarm 'retinal_contact' is {color}" in claim.violations[0].sentence


def test_a_colour_that_only_some_confuse_is_found():
    (claim,) = color_claims(with_color("#3a9d5d", "outside_eye"))
    assert claim.holds
    procedure = with_color("#8a5a20", "outside_eye")  # brown: with deuteranopia like red
    (claim,) = color_claims(procedure)
    assert "'outside_eye' (neutral) is #8a5a20, which looks alike" in claim.violations[0].sentence


@pytest.mark.parametrize("color", ["red", "#12345", "#12345g", "#1234567"])
def test_what_is_no_colour_is_refused(color):
    with pytest.raises(BadInput, match=r"own\.toml"):
        with_color(color)


@pytest.mark.parametrize("color", ["#b00020", "#c62828", "#7a0a1a"])
def test_a_sensible_alarm_colour_holds(color):
    (claim,) = color_claims(with_color(color))
    assert claim.holds
