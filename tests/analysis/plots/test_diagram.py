"""The state diagram: complete, well-formed, deterministic."""

import re
import subprocess
import sys
from itertools import combinations, pairwise
from xml.etree import ElementTree

import pytest
from helpers import text_extents
from making import load, sound

from haptigraph.analysis.plots.diagram import diagram_svg
from haptigraph.assemble import load_procedure, parse_procedure, procedure_names
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


def extents(rect) -> tuple[float, float, float, float]:
    left, top = float(rect.get("x")), float(rect.get("y"))
    return left, top, left + float(rect.get("width")), top + float(rect.get("height"))


def assert_legible(svg: str) -> None:
    root = ElementTree.fromstring(svg)
    groups = list(root.iter(f"{SVG}g"))
    boxes = [extents(group.find(f"{SVG}rect")) for group in groups]
    for one, other in combinations(boxes, 2):
        assert one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
    for group, (left, top, right, bottom) in zip(groups, boxes, strict=True):
        for text in group.iter(f"{SVG}text"):
            start, end = text_extents(text)
            assert left < start, text.text
            assert end < right, text.text
            assert top < float(text.get("y")) < bottom
    for text in root.iter(f"{SVG}text"):
        start, end = text_extents(text)
        assert start >= 0, text.text
        assert end <= float(root.get("width")), text.text
        assert float(text.get("y")) < float(root.get("height"))


@pytest.mark.parametrize("name", procedure_names())
def test_no_box_overlaps_another_and_every_text_fits(name):
    assert_legible(diagram_svg(load_procedure(name)))


def test_long_names_fit(procedure):
    text = procedure.text.replace("target_hit", "the_target_" + "reached_and_held_" * 4 + "now")
    text = text.replace(f'title = "{procedure.title}"', 'title = "' + "Injection below the retina " * 5 + '"')
    longer = parse_procedure(text.replace('"pulse"', f'"{"quick_hard_pulses_" * 3}"'), "longer.toml")
    assert_legible(diagram_svg(longer))


def stretches(root) -> list[tuple[float, float, float, float]]:
    """Straight pieces of a staircase's lines: x, y, to x, to y."""
    pieces = []
    for path in root.findall(f"{SVG}path"):
        x, y, *moves = re.findall(r"([MHV]?)(-?[\d.]+)", path.get("d"))
        points = [(float(x[1]), float(y[1]))]
        for letter, value in moves:
            last = points[-1]
            points.append((float(value), last[1]) if letter == "H" else (last[0], float(value)))
        pieces += [(*start, *end) for start, end in pairwise(points)]
    return pieces


@pytest.mark.parametrize(
    "name", ["membrane_peeling", "subretinal_injection_ioct", "subretinal_injection_phases"]
)
def test_many_neighbours_are_joined_by_dots_where_two_lines_of_their_own_cross(name):
    procedure = load_procedure(name)
    root = ElementTree.fromstring(diagram_svg(procedure))
    dots = root.findall(f"{SVG}circle")
    joined = {tuple(sorted(dot.find(f"{SVG}title").text.split(" - "))) for dot in dots}
    assert joined == {tuple(sorted(pair)) for pair in neighbours(procedure)}
    assert len({(dot.get("cx"), dot.get("cy")) for dot in dots}) == len(dots)
    pieces = stretches(root)
    level = [(y, start, end) for start, y, end, to in pieces if y == to]
    upright = [(x, start, end) for x, start, to, end in pieces if x == to]
    assert len({y for y, *_ in level}) == len(level)
    assert len({x for x, *_ in upright}) == len(upright)
    edge = max(extents(group.find(f"{SVG}rect"))[2] for group in root.iter(f"{SVG}g"))
    assert all(start == edge < end for _, start, end in level)
    assert all(x > edge for x, *_ in upright)
    for dot in dots:
        x, y = float(dot.get("cx")), float(dot.get("cy"))
        assert any(y == at and start <= x <= end for at, start, end in level)
        assert any(x == at and start <= y <= end for at, start, end in upright)


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
