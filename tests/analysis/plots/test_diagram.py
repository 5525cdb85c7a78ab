"""The state diagram: all states, well-formed, the same bytes every time."""

import subprocess
import sys
from xml.etree import ElementTree

import pytest
from making import load, sound

from haptigraph.analysis.plots.diagram import diagram_svg
from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.proof.neighbours import neighbours

SVG = "{http://www.w3.org/2000/svg}"


def drawn(svg: str) -> dict[str, tuple[float, float]]:
    """Where each state's box stands, by the number in it."""
    root = ElementTree.fromstring(svg)
    places = {}
    for group in root.iter(f"{SVG}g"):
        box, number = group.find(f"{SVG}rect"), group.find(f"{SVG}text")
        places[number.text] = (float(box.get("x")), float(box.get("y")))
    return places


@pytest.mark.parametrize("name", procedure_names())
def test_every_state_is_drawn_with_its_priority(name):
    procedure = load_procedure(name)
    svg = diagram_svg(procedure)
    places = drawn(svg)
    assert sorted(places, key=int) == [str(number) for number in range(len(procedure.states))]
    assert len(set(places.values())) == len(places)


def test_misaligned_states_stand_left_and_aligned_ones_right_as_in_the_paper(procedure):
    places = drawn(diagram_svg(procedure))
    left, right = places["5"][0], places["6"][0]
    assert left < right
    assert [places[number][0] for number in ("3", "4")] == [left, right]
    assert places["5"][1] == places["6"][1] < places["3"][1] == places["4"][1] < places["1"][1]
    assert places["7"][1] < places["5"][1]


def test_neighbours_of_the_paper(procedure):
    pairs = neighbours(procedure)
    assert ("retinal_contact", "target_hit") in pairs
    assert ("misaligned_retinal_approach", "aligned_retinal_approach") in pairs
    assert ("aligned_intraocular_navigation", "outside_eye") in pairs
    assert ("retinal_contact", "misaligned_intraocular_navigation") not in pairs  # the approach lies between
    assert ("misaligned_retinal_approach", "aligned_intraocular_navigation") not in pairs  # two measures
    assert not any("unknown" in pair for pair in pairs)


def test_bytes_are_the_same_in_every_process(procedure):
    code = (
        "import sys; from haptigraph.analysis.plots.diagram import diagram_svg; from haptigraph.assemble import load_procedure;"
        "sys.stdout.write(diagram_svg(load_procedure('subretinal_injection')))"
    )
    outputs = {
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            check=True,
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path)},
        ).stdout
        for seed in ("1", "2")
    }
    assert outputs == {diagram_svg(procedure).encode()}


@pytest.mark.parametrize("seed", range(8))
def test_made_up_procedures_are_drawn_too(seed):
    made = load(sound(seed).data)
    assert len(drawn(diagram_svg(made))) == len(made.states)
