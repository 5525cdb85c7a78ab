"""The first message about a run: its procedure, anatomy and view, and how to draw each state.

Pages draw any procedure from it; nothing about a particular one is written in them.
"""

from collections.abc import Callable
from typing import Any

from msgspec import to_builtins

from haptigraph.analysis.plots.diagram import column_of
from haptigraph.assemble import load_procedure
from haptigraph.config import Config
from haptigraph.dashboard.server.hub import Hub
from haptigraph.inference.colors import Paint, palette
from haptigraph.inference.meaning import Kind
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import TIP_NOT_VISIBLE, UNKNOWN
from haptigraph.perception.eye_view import EyeView, view_of
from haptigraph.pipeline import Loop
from haptigraph.registration.assumed import needs_consent
from haptigraph.registration.loading import load_registration, parse_registration
from haptigraph.registration.registered import BaseRegistration
from haptigraph.registration.retarget import with_target
from haptigraph.run_robot import SteeredRobot
from haptigraph.run_settings import suited

__all__ = ["announcement", "describe_relations", "describe_run", "describe_states"]

VIEW_PX = 560
NOT_SEEN = {UNKNOWN: "lost", TIP_NOT_VISIBLE: "tipless"}
"""Icon of a state in which it is not known where the tip is."""
ICONS: dict[Kind, str] = {"alarm": "alarm", "success": "done", "guidance": "warn", "unseen": "unseen"}
"""Icon of a state by its kind, so that states differ in more than colour."""


def announcement(config: Config, loop: Loop, hub: Hub) -> Callable[[], None]:
    """Return a function that makes a hub announce a loop; call it before the server starts or in its thread.

    Args:
        config: The loop's configuration.
        loop: The loop to watch.
        hub: Serves the pages.

    Raises:
        BadInput: If procedure or registration cannot be used.
    """
    if config.source.registration:
        registration = load_registration(config.source.registration)
    else:
        registration = parse_registration(loop.source.registration or "", config.source.uri)
    if config.source.target_mm is not None:
        registration = with_target(registration, config.source.target_mm)
    config = suited(config, loop.source, registration)
    procedure, view = load_procedure(config.run.procedure), view_of(registration, VIEW_PX)
    moving = frozenset(entity.name for entity in procedure.schema.entities) - set(registration.anatomy)
    robot = loop.robot.process if isinstance(loop.robot, SteeredRobot) else None
    teleop = robot or loop.source.teleop
    steering = {
        "steerable": teleop is not None,
        "has_jaws": teleop is not None and teleop.has_jaws,
        "robot": robot.uri if robot else "",
    }
    hello = {**describe_run(config, procedure, registration, view), **steering}
    return lambda: hub.announce(hello, view, moving)


def describe_run(
    config: Config, procedure: Procedure, registration: BaseRegistration, view: EyeView
) -> dict[str, Any]:
    """Return the fields of a run's first message."""
    return {
        "procedure": {
            "name": procedure.name,
            "title": procedure.title,
            "sha256": procedure.sha256,
            "entities": to_builtins(procedure.schema.entities),
            "relations": describe_relations(procedure),
            "states": describe_states(procedure),
            "patterns": to_builtins(procedure.patterns),
        },
        "anatomy": to_builtins(registration.anatomy),
        "view": {
            "size_px": view.size_px,
            "half_mm": view.half_mm,
            "center_mm": view.center_mm,
            "across_mm": view.across_mm,
            "above_mm": view.above_mm,
        },
        "source": config.source.uri,
        "device": config.haptics.device,
        "recording": config.recording.path,
        "stale_ms": config.run.stale_ms,
        "deadman_ms": config.haptics.deadman_ms,
        "assumed": registration.assumed,
        "silenced": needs_consent(registration.assumed) and not config.haptics.accept_assumed,
    }


def describe_relations(procedure: Procedure) -> list[dict[str, Any]]:
    """Return the relations of a procedure, with the measures that decide them."""
    return [
        {**to_builtins(relation), "measure_name": procedure.schema.measure_name(relation)}
        for relation in procedure.schema.relations
    ]


def describe_states(procedure: Procedure) -> list[dict[str, Any]]:
    """Return how to draw the states of a procedure, in order of priority."""
    kinds, paints = procedure.kinds, palette(procedure)
    return [
        _describe_state(state, kinds[state.name], paints[state.name], priority)
        for priority, state in enumerate(procedure.states)
    ]


def _describe_state(state: State, kind: Kind, paint: Paint, priority: int) -> dict[str, Any]:
    column = column_of(state)
    neutral = "calm" if column == "right" else "idle"
    return {
        **to_builtins(state),
        "priority": priority,
        "label": state.name.replace("_", " "),
        "column": column,
        "kind": kind,
        "icon": NOT_SEEN.get(state.name) or ICONS.get(kind, neutral),
        "color": paint.color,
        "ink": paint.ink,
    }
