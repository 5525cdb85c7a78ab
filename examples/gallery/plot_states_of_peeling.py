"""
A procedure with many neighbours
================================

Where lines would pass too many boxes, states stand one below the other. A dot joins the state of its row
and that of its column.
"""

import haptigraph
from haptigraph.analysis.plots.diagram import diagram_svg
from haptigraph.analysis.plots.svg import write_svg

write_svg(diagram_svg(haptigraph.load_procedure("membrane_peeling")), "peeling.svg")
