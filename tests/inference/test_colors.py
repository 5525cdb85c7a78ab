"""Colours follow from meaning, differ for any colour vision, and text on them is readable."""

from itertools import combinations
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.assemble import load_procedure, parse_procedure, procedure_names
from haptigraph.inference.color_vision import contrast, difference, ink_on, least_difference
from haptigraph.inference.colors import PAPER_PALETTE, palette, palette_of
from haptigraph.inference.meaning import Kind

KINDS = st.lists(st.sampled_from(get_args(Kind)), min_size=1, max_size=30)
COLORS = st.integers(0, 0xFFFFFF).map(lambda number: f"#{number:06x}")
READABLE = 4.5


def test_contrast_is_that_of_wcag():
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    assert contrast("#ffffff", "#3a9d5d") == pytest.approx(3.4, abs=0.05)  # white on green was not readable
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)


def test_red_and_green_are_closer_with_deuteranopia():
    assert difference("#ff0000", "#ff0000") == 0
    assert difference("#ffffff", "#000000") == pytest.approx(100, abs=0.1)
    assert difference("#d03a3a", "#3a9d5d", "deuteranopia") < difference("#d03a3a", "#3a9d5d") / 3


@given(COLORS)
def test_black_or_white_is_readable_on_any_colour(color):
    assert contrast(ink_on(color), color) >= READABLE


@given(KINDS)
def test_states_of_any_procedure_are_readable_and_alarms_look_like_nothing_else(kinds):
    states = {f"state_{number}": kind for number, kind in enumerate(kinds)}
    paints = palette_of(states)
    assert all(contrast(paint.ink, paint.color) >= READABLE for paint in paints.values())
    for one, other in combinations(states, 2):
        if states[one] != states[other] and "alarm" in (states[one], states[other]):
            assert least_difference(paints[one].color, paints[other].color) >= 15
        if {states[one], states[other]} <= {"guidance", "success", "neutral"} and states[one] != states[
            other
        ]:
            assert difference(paints[one].color, paints[other].color) >= 25


@given(KINDS)
def test_a_few_states_of_one_kind_differ_in_shade(kinds):
    states = {f"state_{number}": kind for number, kind in enumerate(kinds)}
    paints = palette_of(states)
    for kind in set(kinds):
        colors = [paints[name].color for name in states if states[name] == kind]
        if len(colors) <= 8:
            assert len({*colors}) == len(colors)


@pytest.mark.parametrize("name", procedure_names())
def test_text_is_readable_and_alarms_are_red_in_every_shipped_procedure(name):
    procedure = load_procedure(name)
    for state, paint in palette(procedure).items():
        assert contrast(paint.ink, paint.color) >= READABLE
        red, green, blue = (int(paint.color[at : at + 2], 16) for at in (1, 3, 5))
        assert (red > 2 * max(green, blue)) == (procedure.kinds[state] == "alarm")


def test_too_deep_is_no_longer_green():
    paints = palette(load_procedure("subretinal_injection_phases"))
    assert paints["too_deep"] != paints["target_hit"]
    assert palette(load_procedure("subretinal_injection")) == PAPER_PALETTE


def test_a_colour_of_ones_own_replaces_that_of_the_kind(procedure):
    text = procedure.text.replace('name = "target_hit"', 'name = "target_hit"\ncolor = "#004400"')
    paints = palette(parse_procedure(text, "own.toml"))
    assert (paints["target_hit"].color, paints["target_hit"].ink) == ("#004400", "#ffffff")
