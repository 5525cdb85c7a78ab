"""Bounds with units become numbers in the unit of their measure."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.assemble import load_procedure, parse_procedure
from haptigraph.errors import BadInput

TEXT = load_procedure("subretinal_injection").text


def written(old, new):
    assert old in TEXT
    return parse_procedure(TEXT.replace(old, new, 1), "p.toml")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ('"0.7 mm"', 0.7),
        ('"700 um"', 0.7),
        ('"700um"', 0.7),
        ('"0.0007 m"', 0.7),
        ('"0.07 cm"', 0.7),
        ('"700 µm"', 0.7),
        ("0.7", 0.7),
    ],
)
def test_a_length_is_exact_in_every_unit(text, value):
    assert written("at_most = 0.7", f"at_most = {text}").schema.relations[0].at_most == value


def test_an_angle_in_radians_is_converted():
    relation = written("at_most = 1.7", 'at_most = "0.03 rad"').schema.relations[4]
    assert relation.at_most == pytest.approx(1.7189, abs=1e-4)


def test_gaps_have_units_too():
    gap = written("above = 5.5\nbecause", 'above = "5500 um"\nbecause').gaps[0]
    assert gap.above == 5.5


@pytest.mark.parametrize(
    "text", ['"1.7 mm"', '"1.7 degrees"', '"deg"', '"1.7"', '"1e400 deg"', '""', '"-- deg"']
)
def test_anything_else_is_refused_with_what_would_be_valid(text):
    with pytest.raises(BadInput, match=r"line 9\d: at_most: expected a number.*valid: deg, rad"):
        written("at_most = 1.7", f"at_most = {text}")


@given(st.integers(10, 14_999))
def test_micrometres_and_millimetres_agree(length_um):
    lengths = [f'"{length_um} um"', f'"{length_um / 1000} mm"', str(length_um / 1000)]
    bounds = {
        written("above = 0.7\nat_most = 5.5\nrecorded_only", f"at_most = {one}\nrecorded_only")
        .schema.relations[3]
        .at_most
        for one in lengths
    }
    assert bounds == {length_um / 1000}
