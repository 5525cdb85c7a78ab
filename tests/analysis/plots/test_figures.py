import io
import itertools

import cv2
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from paths import ROOT

from haptigraph import assemble
from haptigraph.analysis.plots.drawing import grey_norm
from haptigraph.analysis.plots.explanation import explain
from haptigraph.analysis.plots.figures import run_figure
from haptigraph.analysis.plots.scene_graph import draw_graph, graph_figure
from haptigraph.assemble import parse_procedure
from haptigraph.config import load_config
from haptigraph.graph import Node, SceneGraph, Triplet
from haptigraph.recording.reader import RunReader

GOLDEN = ROOT / "tests" / "replay" / "golden"


def test_a_run_is_drawn(sparse_uri, tmp_path):
    path = tmp_path / "r.mcap"
    settings = (f"source.uri={sparse_uri}", "run.realtime=false", f'recording.path="{path}"')
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


@pytest.mark.parametrize(
    "name", ["wrong_place_then_hit", "ioct_approach", "membrane_peeling", "injection_with_phases"]
)
def test_labels_of_a_graph_overlap_neither_each_other_nor_a_node(name):
    with RunReader(GOLDEN / f"{name}.mcap") as run:
        schema = parse_procedure(run.info.procedure, name).schema
        graphs = {str(step.graph.edges): step.graph for _, step in run.records(images=())}
    for graph in list(graphs.values())[::5]:
        figure = Figure(figsize=(4, 2.6), dpi=100)
        axes = figure.add_axes((0, 0, 1, 1))
        draw_graph(axes, graph, schema.relations)
        FigureCanvasAgg(figure).draw()
        labels = [text.get_window_extent() for text in axes.texts if text.get_text()]
        for one, other in itertools.combinations(labels, 2):
            assert not one.padded(-1.5).overlaps(other.padded(-1.5)), graph.edges


def test_an_edge_passes_a_node_by():
    nodes = [Node(name, name, group) for name, group in (("a", "1"), ("b", "2"), ("c", "3"))]
    figure = Figure(figsize=(5, 3), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    draw_graph(axes, SceneGraph(0, tuple(nodes), (Triplet("a", "near", "c"),)))
    FigureCanvasAgg(figure).draw()
    (label,) = [text for text in axes.texts if text.get_text() == "near"]
    assert abs(label.get_position()[1]) > 0.1


def test_a_dim_eye_becomes_visible_and_a_bright_one_stays():
    dim = np.full((50, 50), 40, np.uint8)
    dim[:, :3], dim[0] = 20, 230
    assert 0.3 < grey_norm([dim])(40) < 0.5
    bright = np.tile(np.linspace(20, 230, 50).astype(np.uint8), (50, 1))
    assert grey_norm([bright])(125) == pytest.approx(0.5, abs=0.02)
    assert grey_norm([np.zeros((5, 5), np.uint8)])(255) == 1


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
