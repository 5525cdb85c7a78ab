"""Golden recordings: what the pipeline made of these images once, it makes of them still.

Other processors round differently, so positions, measures and the patterns that follow them may differ slightly;
nothing else may.
"""

import paths
import pytest
from msgspec import to_builtins

from haptigraph.analysis.metrics.replay import replay_steps
from haptigraph.recording.reader import RunReader
from haptigraph.sim.scenario import scenario_names

GOLDEN = sorted(paths.GOLDEN.glob("*.mcap"))
TOLERANCE = 1e-4
UNRECORDED = ("volume_approach",)
"""Volumes are large, and the fit of their needle draws poses, so that rounding has larger effects."""


def numbers(message) -> list[float]:
    return flat(to_builtins(message))


def flat(value, unit=1.0) -> list[float]:
    """Every number in it, in order; stamps in seconds."""
    if isinstance(value, int | float):
        return [value * unit]
    if value is None or isinstance(value, str):
        return []
    named = value.items() if isinstance(value, dict) else (("", item) for item in value)
    return [number for name, item in named for number in flat(item, 1e-9 if name.endswith("_ns") else 1.0)]


def test_every_shipped_scenario_has_its_golden_recording():
    assert [path.stem for path in GOLDEN] == [name for name in scenario_names() if name not in UNRECORDED]


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_nothing_has_changed(path):
    count = 0
    for recorded, again in replay_steps(RunReader(path)):
        where = f"step {count} of {path.name}"
        assert again.conclusion.state == recorded.conclusion.state, where
        pattern = again.command.pattern
        assert (pattern.name, pattern.kind) == (recorded.command.pattern.name, recorded.command.pattern.kind)
        assert numbers(again.command) == pytest.approx(numbers(recorded.command), abs=TOLERANCE), where
        assert again.graph.nodes == recorded.graph.nodes, where
        assert again.graph.edges == recorded.graph.edges, where
        assert again.graph.measures == pytest.approx(recorded.graph.measures, abs=TOLERANCE), where
        found, found_before = numbers(again.observation.found), numbers(recorded.observation.found)
        assert found == pytest.approx(found_before, abs=TOLERANCE), where
        sd, sd_before = numbers(again.observation.certainty), numbers(recorded.observation.certainty)
        assert sd == pytest.approx(sd_before, abs=TOLERANCE, nan_ok=True), where
        count += 1
    assert count > 25
