import io

import cv2
import pytest

from haptigraph import assemble
from haptigraph.analysis.plots.scene_graph import graph_figure
from haptigraph.analysis.plots.explanation import explain
from haptigraph.analysis.plots.figures import run_figure
from haptigraph.config import load_config
from haptigraph.graph import Node, SceneGraph, Triplet


def test_a_run_is_drawn(quick_uri, tmp_path):
    path = tmp_path / "r.mcap"
    settings = (f"source.uri={quick_uri}", "run.realtime=false", f'recording.path="{path}"')
    assemble.build(load_config(None, (*settings, "trial.participant=P1"))).run()
    run_figure(path, tmp_path / "run.png")
    figure = cv2.imread(str(tmp_path / "run.png"))
    assert figure.shape[0] > 800
    red = cv2.inRange(figure, (50, 50, 200), (65, 65, 215))  # retinal contact has its band
    assert red.any()


@pytest.mark.parametrize(
    "graph",
    [
        SceneGraph(0),
        SceneGraph(0, (Node("a", "a", "anatomy"),)),
        SceneGraph(
            0,
            (Node("tip", "needle_tip", "instrument"), Node("retina", "retina_surface", "anatomy")),
            (Triplet("tip", "touching", "retina"), Triplet("tip", "approaching", "retina")),
        ),
    ],
)
def test_any_graph_is_drawn(graph, tmp_path):
    graph_figure(graph, tmp_path / "graph.svg")
    drawing = (tmp_path / "graph.svg").read_text()
    assert "<svg" in drawing


def test_a_procedure_is_explained_completely(procedure):
    from rich.console import Console

    console = Console(width=200, record=True, file=io.StringIO())
    for table in explain(procedure):
        console.print(table)
    text = console.export_text()
    for relation in procedure.schema.relations:
        assert f"<{', '.join(relation.names)}>" in text
    for state in procedure.states:
        assert state.name in text
    assert "radial_mm <= 0.7 and <needle_tip, touching, retina_surface>" in text
    assert "not <needle_tip, touching, retina_target>" in text
    assert "2 x 100 ms on, 100 ms off, once (300 ms)" in text
