"""
A whole run on one page
=======================

A moment of the rarest states with its scene graph, and the run over time below. ``haptigraph demo``
draws it of its run.
"""

from haptigraph.analysis.plots.figures import run_figure

run_figure("../../tests/replay/golden/misaligned_then_correct.mcap", "overview.png")
