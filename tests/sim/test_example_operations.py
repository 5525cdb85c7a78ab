"""Vein cannulation and laser photocoagulation reach every state on their own scenarios."""

from pathlib import Path

import pytest

import haptigraph
from haptigraph.assemble import load_procedure
from haptigraph.sim.scenario import scenario_document

EXAMPLES = ("laser_photocoagulation", "vein_cannulation")
MOMENTARY = {"unknown", "tip_not_visible"}
"""States in which the needle or its tip is lost; the scenarios do not set out to lose them."""


def steps_of(name: str, folder: Path) -> list[haptigraph.Step]:
    """Run a scenario with its own procedure, at 10 images a second to save time."""
    text = scenario_document(name).text
    scenario = folder / f"{name}.toml"
    scenario.write_text(text.replace("[scenario]\n", "[scenario]\nrate_hz = 10.0\n", 1))
    settings = [f"source.uri=phantom:{scenario}", "run.realtime=false", f"run.procedure={name}"]
    return list(haptigraph.build(haptigraph.load_config(settings=settings)).steps())


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_reaches_all_its_states_on_its_scenario(name, tmp_path):
    procedure = load_procedure(name)
    steps = steps_of(name, tmp_path)
    reached = {step.conclusion.state for step in steps}
    assert {state.name for state in procedure.states} - MOMENTARY <= reached
    alarms = {state.name for state in procedure.states if state.kind == "alarm"}
    played = {step.command.pattern.name for step in steps if step.conclusion.state in alarms}
    assert played == {"pulse"}
