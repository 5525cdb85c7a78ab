"""Say to a page, once, what it will see: the procedure, the anatomy, the view, and how to draw each state.

The page draws any procedure; nothing about this one is written in it.
"""

from typing import Any

from msgspec import to_builtins

from haptigraph.analysis.plots.colors import ink_on, state_color
from haptigraph.analysis.plots.diagram import column_of
from haptigraph.config import Config
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import UNKNOWN
from haptigraph.perception.eye_view import IoctView
from haptigraph.registration.registered import Registered

__all__ = ["describe", "describe_states", "described_state"]

SIGNS = {"pulses": "alarm", "bursts": "done", "continuous": "warn"}
"""The shape that stands for a state, by the kind of pattern it feels like: colour is never the only sign."""


def describe(
    config: Config, procedure: Procedure, registration: Registered, view: IoctView
) -> dict[str, Any]:
    """Return the page's first message, but for its type, as what JSON can hold."""
    return {
        "procedure": {
            "name": procedure.name,
            "title": procedure.title,
            "sha256": procedure.sha256,
            "entities": to_builtins(procedure.schema.entities),
            "relations": [
                {**to_builtins(relation), "measure_name": procedure.schema.measure_name(relation)}
                for relation in procedure.schema.relations
            ],
            "states": describe_states(procedure),
            "patterns": to_builtins(procedure.patterns),
        },
        "anatomy": to_builtins(registration.anatomy),
        "view": {"size_px": view.size_px, "half_mm": view.half_mm},
        "source": config.source.uri,
        "device": config.haptics.device,
        "recording": config.recording.path,
        "stale_ms": config.run.stale_ms,
        "deadman_ms": config.haptics.deadman_ms,
    }


def describe_states(procedure: Procedure) -> list[dict[str, Any]]:
    """Return how to draw the states of a procedure, in their order."""
    kinds = {pattern.name: pattern.kind for pattern in procedure.patterns}
    return [
        described_state(state, kinds[state.feel], priority) for priority, state in enumerate(procedure.states)
    ]


def described_state(state: State, kind: str, priority: int) -> dict[str, Any]:
    """Return how to draw a state.

    Args:
        state: The state.
        kind: Of the pattern it feels like.
        priority: Its place among the states, 0 first.
    """
    column = column_of(state)
    silent = "calm" if column == "right" else "idle"
    return {
        **to_builtins(state),
        "priority": priority,
        "label": state.name.replace("_", " "),
        "column": column,
        "sign": "lost" if state.name == UNKNOWN else SIGNS.get(kind, silent),
        "color": state_color(state.name),
        "ink": ink_on(state.name),
    }
