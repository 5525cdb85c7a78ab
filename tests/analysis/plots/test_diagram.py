"""The state diagram: complete, well-formed, deterministic."""

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
    """Position of each state's box, by its number."""
    root = ElementTree.fromstring(svg)
    boxes = {}
    for group in root.iter(f"{SVG}g"):
        box, number = group.find(f"{SVG}rect"), group.find(f"{SVG}text")
        boxes[number.text] = (float(box.get("x")), float(box.get("y")))
    return boxes


@pytest.mark.parametrize("name", procedure_names())
def test_every_state_is_drawn_with_its_priority(name):
    procedure = load_procedure(name)
    svg = diagram_svg(procedure)
    boxes = drawn(svg)
    assert sorted(boxes, key=int) == [str(number) for number in range(len(procedure.states))]
    assert len(set(boxes.values())) == len(boxes)


def test_misaligned_states_are_left_and_aligned_ones_right_as_in_the_paper(procedure):
    boxes = drawn(diagram_svg(procedure))
    left, right = boxes["6"][0], boxes["7"][0]
    assert left < right
    assert [boxes[number][0] for number in ("4", "5")] == [left, right]
    assert boxes["6"][1] == boxes["7"][1] < boxes["4"][1] == boxes["5"][1] < boxes["2"][1]
    assert boxes["8"][1] < boxes["6"][1]
    assert boxes["2"][1] < boxes["0"][1] == boxes["1"][1]  # without a tip


def test_neighbours_of_the_paper(procedure):
    pairs = neighbours(procedure)
    assert ("retinal_contact", "target_hit") in pairs
    assert ("misaligned_retinal_approach", "aligned_retinal_approach") in pairs
    assert ("aligned_intraocular_navigation", "outside_eye") in pairs
    assert ("retinal_contact", "misaligned_intraocular_navigation") not in pairs  # the approach is between
    assert ("misaligned_retinal_approach", "aligned_intraocular_navigation") not in pairs  # two measures
    assert not any({"unknown", "tip_not_visible"} & set(pair) for pair in pairs)


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
def test_generated_procedures_are_drawn(seed):
    made = load(sound(seed).data)
    assert len(drawn(diagram_svg(made))) == len(made.states)
