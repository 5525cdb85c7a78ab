"""
The scene graph of a moment
===========================

Instruments are on the left, what they relate to on the right. Here the tip touches the retina beside the
target.
"""

import haptigraph
from haptigraph.analysis.plots.scene_graph import graph_figure

with haptigraph.RunReader("../../tests/replay/golden/wrong_place_then_hit.mcap") as run:
    step = next(step for _, step in run.records(images=()) if step.conclusion.state == "retinal_contact")
graph_figure(step.graph, "graph.png")
