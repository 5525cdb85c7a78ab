"""
A timeline for a paper
======================

The run over time at the width of two columns, with panel letters. ``haptigraph figure RUN --kind timeline``
writes the same as PDF, SVG or PNG.
"""

from haptigraph.analysis.paper.figure import paper_figure

paper_figure("../../tests/replay/golden/wrong_place_then_hit.mcap", "timeline", "timeline.png")
