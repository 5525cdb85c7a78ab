import json

import pytest
from helpers import call, refuse
from mcap.reader import make_reader

from haptigraph.analysis.exporting.foxglove_layout import foxglove_layout

PANELS = {  # in the layout's file: in Foxglove's own library
    "Image": ("ImagePanel", "ImageConfig"),
    "Plot": ("PlotPanel", "PlotConfig"),
    "RawMessages": ("RawMessagesPanel", "RawMessagesConfig"),
    "RosOut": ("LogPanel", "LogConfig"),
    "StateTransitions": ("StateTransitionsPanel", "StateTransitionsConfig"),
}
SERIES = {"Plot": "PlotSeries", "StateTransitions": "StateTransitionsSeries"}


@pytest.fixture(scope="module")
def layout(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("layout") / "layout.json"
    result = call("export", recording, "--foxglove-layout", path)
    assert result.exit_code == 0, result.stderr
    return json.loads(path.read_text())


@pytest.fixture(scope="module")
def schemas(recording):
    """The schema of every topic, as the recording's file has it."""
    with open(recording, "rb") as file:
        summary = make_reader(file).get_summary()
    return {
        channel.topic: json.loads(summary.schemas[channel.schema_id].data)
        for channel in summary.channels.values()
    }


def panels(node):
    """The panels of a tree, each once."""
    if isinstance(node, str):
        return [node]
    assert node["direction"] in ("row", "column")
    assert 0 < node["splitPercentage"] < 100
    return panels(node["first"]) + panels(node["second"])


def message_paths(layout):
    for identifier, config in layout["configById"].items():
        yield from (path["value"] for path in config.get("paths", ()))
        yield from (config[key] for key in ("topicPath", "topicToRender") if key in config)
        if identifier.startswith("Image!"):
            yield config["imageMode"]["imageTopic"]
            yield from config["imageMode"]["annotations"]


def resolve(schema, fields):
    """The part of a JSON schema that a path of fields leads to."""
    part = schema
    for field in fields:
        while "$ref" in part:
            part = schema["$defs"][part["$ref"].rpartition("/")[2]]
        part = part["properties"][field]
    return part


def test_every_panel_is_shown_once(layout):
    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])


def test_every_topic_and_field_exists_in_a_recording(layout, schemas):
    paths = list(message_paths(layout))
    assert len(paths) > 8
    for path in paths:
        topic, *fields = path.split(".")
        resolve(schemas[topic], fields)
    with pytest.raises(KeyError):
        resolve(schemas["/graph"], ["measures", "no_such_measure"])


def test_image_annotations_states_theta_output_graph_and_faults_are_shown(layout):
    paths = set(message_paths(layout))
    assert {
        "/camera/image",
        "/camera/annotations",
        "/state.state",
        "/graph.measures.theta_deg",
        "/graph.measures.distance_to_retina_mm",
        "/command.pattern.amplitude",
        "/graph",
        "/log",
    } <= paths


def test_plotted_values_are_numbers_and_states_are_text(layout, schemas):
    for identifier, config in layout["configById"].items():
        kind = {"Plot": "number", "StateTransitions": "string"}.get(identifier.partition("!")[0])
        for path in config.get("paths", ()):
            topic, *fields = path["value"].split(".")
            assert resolve(schemas[topic], fields)["type"] == kind


def test_panels_and_their_settings_are_those_of_foxgloves_library(layout):
    library = pytest.importorskip("foxglove.layouts")
    for identifier, config in layout["configById"].items():
        kind = identifier.partition("!")[0]
        panel, settings = (getattr(library, name) for name in PANELS[kind])
        names = {"RosOut": "Log"}  # files keep the first name of this panel
        assert panel()._to_dict()["panelType"] == names.get(kind, kind)
        assert set(config) <= set(settings()._to_dict())
        for path in config.get("paths", ()):
            assert set(path) <= set(getattr(library, SERIES[kind])()._to_dict())
        if kind == "Image":
            assert set(config["imageMode"]) <= set(library.ImageModeConfig()._to_dict())


def test_measures_of_any_procedure_are_plotted():
    configs = foxglove_layout(("theta_deg", "depth_mm", "share"))["configById"]
    values = {path["value"] for config in configs.values() for path in config.get("paths", ())}
    assert {"/graph.measures.theta_deg", "/graph.measures.depth_mm"} <= values
    assert "/graph.measures.share" not in values  # neither an angle nor a distance


def test_no_file_is_overwritten(recording, tmp_path):
    path = tmp_path / "layout.json"
    path.write_text("mine")
    assert f"{path}: exists already" in refuse("export", recording, "--foxglove-layout", path)
    assert path.read_text() == "mine"
    assert "cannot be written" in refuse(
        "export", recording, "--foxglove-layout", tmp_path / "none" / "x.json"
    )
