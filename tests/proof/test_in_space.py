"""A procedure may use the measures of a shaft in space, with margins, and is proved like any other."""

import re

import pytest

from haptigraph.assemble import load_procedure, parse_procedure, perceiver_class
from haptigraph.errors import BadInput
from haptigraph.inference.coverage import NEEDLE_3D, check_margins, unreported
from haptigraph.perception import entities
from haptigraph.proof.prove import prove

IN_SPACE = """
[[entity]]
name = "needle_3d"
group = "instrument"
geometry = "segment"
label = "shaft in space"
only_with = "needle_tip"

[[relation]]
subject = "needle_3d"
predicate = "leaning"
object = "eye_globe"
measure = "out_of_plane_mm"
at_least = 1.5
release = 1.3
margin_sd = 1.0

[[relation]]
subject = "needle_3d"
predicate = "leaning_too_far"
object = "eye_globe"
measure = "out_of_plane_deg"
above = 5.0
margin_sd = 1.0
recorded_only = true

[[relation]]
subject = "needle_3d"
predicate = "aligned"
object = "retina_target"
measure = "theta_space_deg"
at_most = 1.7
margin_sd = 1.0
recorded_only = true

"""
LEANING = """[[state]]
name = "leaning_retinal_approach"
kind = "guidance"
when = [["needle_tip", "approaching", "retina_surface"], ["needle_line", "misaligned", "retina_target"], ["needle_3d", "leaning", "eye_globe"]]
feel = "low"
because = "the tip is {out_of_plane_mm:.1f} mm out of the section"

"""


@pytest.fixture(scope="module")
def in_space():
    text = load_procedure("subretinal_injection").text
    before_gap, before_state = "[[gap]]", '[[state]]\nname = "misaligned_retinal_approach"'
    assert before_gap in text
    assert before_state in text
    text = text.replace(before_gap, IN_SPACE + before_gap, 1).replace(before_state, LEANING + before_state, 1)
    return parse_procedure(text, "in space")


def graphs(proof):
    return int(re.search(r"[0-9]+", proof.method)[0])


def test_its_claims_are_proved_over_more_graphs(in_space):
    proof, paper = prove(in_space), prove(load_procedure("subretinal_injection"))
    wrong = [claim for claim in proof.violations if "approach comes first" not in str(claim)]
    assert wrong == []
    assert graphs(proof) > graphs(paper)


def test_margins_are_accepted_before_a_camera_alone(in_space):
    check_margins(in_space, "tracker", perceiver_class("tracker"))
    with pytest.raises(BadInput, match="perceiver volume estimates no standard deviation of needle_3d"):
        check_margins(in_space, "volume", perceiver_class("volume"))


def test_the_shaft_in_space_is_reported_beside_any_perceiver(in_space):
    assert NEEDLE_3D == entities.NEEDLE_3D
    assert (
        unreported(in_space, {"needle_tip", "needle_line", "eye_globe", "retina_surface", "retina_target"})
        == {}
    )
