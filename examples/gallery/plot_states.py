"""
The states of a procedure
=========================

Misaligned states are on the left, aligned ones on the right. A line joins two states if one measure that
crosses one threshold leads from one to the other. ``haptigraph diagram subretinal_injection`` writes the
same.
"""

import haptigraph
from haptigraph.analysis.plots.diagram import diagram_svg
from haptigraph.analysis.plots.svg import write_svg

write_svg(diagram_svg(haptigraph.load_procedure("subretinal_injection")), "states.svg")
