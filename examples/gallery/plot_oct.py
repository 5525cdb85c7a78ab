"""
A run in B-scans
================

The same figure of an approach that intraoperative OCT sees. Each layer has a colour of its own, and
distances are in µm.
"""

from haptigraph.analysis.plots.figures import run_figure

run_figure("../../tests/replay/golden/ioct_approach.mcap", "oct.png")
