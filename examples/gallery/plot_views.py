"""
A moment in three views
=======================

The raw image, the displayed eye with what was found in it, and the state for every position of the tip.
``haptigraph figure RUN --kind views`` writes the same.
"""

from haptigraph.analysis.paper.figure import paper_figure

paper_figure("../../tests/replay/golden/wrong_place_then_hit.mcap", "views", "views.png")
