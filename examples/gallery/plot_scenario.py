"""
A scenario's motions
====================

What the numbers of a simulated scenario mean in its eye: where the shaft and the tip are after each move.
``haptigraph diagram phantom:wrong_place_then_hit`` writes the same.
"""

from haptigraph.analysis.plots.scenario_diagram import scenario_svg
from haptigraph.analysis.plots.svg import write_svg
from haptigraph.sim.scenario import load_scenario

write_svg(scenario_svg(load_scenario("wrong_place_then_hit")), "scenario.svg")
