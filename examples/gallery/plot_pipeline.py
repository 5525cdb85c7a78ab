"""
Every stage of perception
=========================

What the two camera perceivers make of one image: the paper's above, the tracker below.
``haptigraph figure RUN --kind pipeline --at 6`` writes the same.
"""

from haptigraph.analysis.paper.figure import paper_figure

paper_figure("../../tests/replay/golden/wrong_place_then_hit.mcap", "pipeline", "pipeline.png", at_s=6.0)
