"""The figure of a scenario: poses where the simulated needle really is, with what the rules measure there."""

from xml.etree import ElementTree

import pytest
from helpers import call, refuse, text_extents

from haptigraph.analysis.plots.scenario_diagram import scenario_svg
from haptigraph.sim.scenario import load_scenario, scenario_document, scenario_names

SVG = "{http://www.w3.org/2000/svg}"
SCENARIO = """
[scenario]
description = "In, wait, on."
[eye]
target_deg = 0
trocar_deg = 0
[[move]]
duration_s = 1
depth_mm = 22.85
theta_deg = 0
[[move]]
duration_s = 1
depth_mm = 22.85
theta_deg = 0
[[move]]
duration_s = 1
depth_mm = 25.85
theta_deg = 0
[[move]]
duration_s = 1
depth_mm = 1
theta_deg = 0
away = true
"""


def words(svg: str) -> list[str]:
    return [text.text for text in ElementTree.fromstring(svg).iter(f"{SVG}text")]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "eye.toml"
    path.write_text(SCENARIO)
    return path


def test_lengths_are_those_of_the_eye(file):
    drawn = words(scenario_svg(load_scenario(str(file))))
    assert "dashed line: the axis, 24.9 mm from trocar to target" in drawn  # 24 and half of the wall's 1.7
    start = drawn.index("1-2", drawn.index("move"))
    assert drawn[start : start + 10] == [
        "1-2", "22.85", "0", "2.0 mm", "0.0 mm",
        "3", "25.85", "0", "-1.0 mm", "0.0 mm",
    ]  # fmt: skip


def test_a_turned_needle_is_off_the_axis(file):
    file.write_text(SCENARIO.replace("depth_mm = 25.85\ntheta_deg = 0", "depth_mm = 20\ntheta_deg = 30"))
    drawn = words(scenario_svg(load_scenario(str(file))))
    assert "10.0 mm" in drawn  # 20 mm * sin 30 degrees
    assert "theta_deg 30" in drawn


def test_moves_away_are_not_drawn(file):
    assert "4" not in words(scenario_svg(load_scenario(str(file))))


def test_command_draws_a_scenario_and_refuses_an_unknown_one(file, tmp_path):
    output = tmp_path / "eye.svg"
    assert call("diagram", f"phantom:{file}", "-o", output).exit_code == 0
    assert output.read_text() == scenario_svg(load_scenario(str(file)))
    assert "unknown scenario 'eye'" in refuse("diagram", "phantom:eye", "-o", tmp_path / "b.svg")
    assert "exists already" in refuse("diagram", f"phantom:{file}", "-o", output)


@pytest.mark.parametrize(
    "name", [name for name in scenario_names() if "scan" not in scenario_document(name).data]
)
def test_every_text_is_inside_the_figure(name):
    root = ElementTree.fromstring(scenario_svg(load_scenario(name)))
    for text in root.iter(f"{SVG}text"):
        start, end = text_extents(text)
        assert start >= 0, text.text
        assert end <= float(root.get("width")), text.text
        assert 0 < float(text.get("y")) < float(root.get("height")), text.text
