"""A layout of Foxglove that shows a recording, or the live bridge, without set-up.

Foxglove imports it as a JSON file: configurations of panels by their identifier, and how they are arranged.
"""

from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from haptigraph.analysis.exporting.writing import write_new
from haptigraph.assemble import parse_procedure
from haptigraph.recording.reader import RunReader

__all__ = ["PROTOBUF", "RECORDED", "Fields", "foxglove_layout", "write_foxglove_layout"]

IMAGE, STATES, THETA = "Image!haptigraph", "StateTransitions!haptigraph", "Plot!haptigraph_theta"
DISTANCES, OUTPUT = "Plot!haptigraph_distances", "Plot!haptigraph_output"
GRAPH, LOG = "RawMessages!haptigraph_graph", "RosOut!haptigraph"


class Fields(NamedTuple):
    """Where the messages have what the layout shows."""

    state: str
    pattern: str
    output: tuple[str, str]
    """Amplitude and frequency."""
    measures: str
    raw: str
    """The topic that is shown as it is."""


RECORDED = Fields(
    "/state.state",
    "/command.pattern.name",
    ("/command.pattern.amplitude", "/command.pattern.frequency_hz"),
    "/graph.measures",
    "/graph",
)
PROTOBUF = Fields("/step.state", "/step.plays", ("/step.amplitude", "/step.frequency_hz"), "/step", "/step")


def write_foxglove_layout(path: str | Path, output: str | Path, *, is_protobuf: bool = False) -> None:
    """Write the layout of a recording.

    Args:
        path: The recording.
        output: The file to write.
        is_protobuf: Whether it shows what `run_foxglove` exports, instead of the recording itself.

    Raises:
        BadInput: If the recording cannot be read, or the file exists or cannot be written.
    """
    info = RunReader(path).info
    measures = parse_procedure(info.procedure, f"procedure in {path}").schema.measure_names
    content = foxglove_layout(measures, PROTOBUF if is_protobuf else RECORDED)
    layout = msgspec.json.format(msgspec.json.encode(content), indent=2)
    write_new(output, layout + b"\n")


def foxglove_layout(measures: tuple[str, ...], fields: Fields = RECORDED) -> dict[str, Any]:
    """Return the layout for graphs with these measures.

    It shows the image with what was detected, the states, angles, distances, the haptic output, the graph and
    the faults. Panels follow one another in time.

    Args:
        measures: Their names.
        fields: Where the messages have what is shown.
    """
    angles = [name for name in measures if name.endswith("_deg")]
    distances = [name for name in measures if name.endswith("_mm")]
    panels: dict[str, Any] = {
        IMAGE: {
            "imageMode": {
                "imageTopic": "/camera/image",
                "annotations": {"/camera/annotations": {"visible": True}},
            }
        },
        STATES: {
            "paths": [
                {"value": value, "label": label, "timestampMethod": "receiveTime"}
                for value, label in ((fields.state, "state"), (fields.pattern, "haptic output"))
            ],
            "isSynced": True,
        },
        THETA: _plot([f"{fields.measures}.{name}" for name in angles]),
        DISTANCES: _plot([f"{fields.measures}.{name}" for name in distances]),
        OUTPUT: _plot(list(fields.output)),
        GRAPH: {"topicPath": fields.raw, "diffEnabled": False},
        LOG: {"topicToRender": "/log", "minLogLevel": 1, "searchTerms": []},
    }
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _row(
            _column(IMAGE, STATES, 70),
            _column(_column(THETA, DISTANCES, 50), _column(OUTPUT, _row(GRAPH, LOG, 60), 40), 50),
            55,
        ),
    }


def _plot(paths: list[str]) -> dict[str, Any]:
    lines = [
        {
            "value": path,
            "label": path.rpartition(".")[2],
            "enabled": True,
            "timestampMethod": "receiveTime",
        }
        for path in paths
    ]
    return {"paths": lines, "xAxisVal": "timestamp", "isSynced": True, "showLegend": True}


def _row(first: Any, second: Any, percentage: int) -> dict[str, Any]:
    return {"direction": "row", "first": first, "second": second, "splitPercentage": percentage}


def _column(first: Any, second: Any, percentage: int) -> dict[str, Any]:
    return _row(first, second, percentage) | {"direction": "column"}
