"""Golden recordings: what the pipeline made of these images once, it makes of them still.

Other processors may round differently, so places and measures may differ by a millionth; nothing else may.
"""

import paths
import pytest
from msgspec import to_builtins

from haptigraph.analysis.metrics.replay import replay_steps
from haptigraph.recording.reader import RunReader
from haptigraph.sim.scenario import scenario_names

GOLDEN = sorted(paths.GOLDEN.glob("*.mcap"))
TOLERANCE = 1e-4


def numbers(observation) -> list[float]:
    return flat(to_builtins(observation.found))


def flat(value) -> list[float]:
    """Every number in it, in order."""
    if isinstance(value, int | float):
        return [value]
    if isinstance(value, str):
        return []
    return [
        number for item in (value.values() if isinstance(value, dict) else value) for number in flat(item)
    ]


def test_every_shipped_scenario_has_its_golden_recording():
    assert [path.stem for path in GOLDEN] == scenario_names()


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_nothing_has_changed(path):
    count = 0
    for recorded, again in replay_steps(RunReader(path)):
        where = f"step {count} of {path.name}"
        assert again.conclusion.state == recorded.conclusion.state, where
        assert again.command == recorded.command, where
        assert again.graph.nodes == recorded.graph.nodes, where
        assert again.graph.edges == recorded.graph.edges, where
        assert again.graph.measures == pytest.approx(recorded.graph.measures, abs=TOLERANCE), where
        assert numbers(again.observation) == pytest.approx(numbers(recorded.observation), abs=TOLERANCE), (
            where
        )
        count += 1
    assert count > 25
