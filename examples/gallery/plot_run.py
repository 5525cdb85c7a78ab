"""
A run over time
===============

States, angle, distances and haptic output of a run, as a notebook shows them. Dashed lines are the
thresholds of the procedure.
"""

import haptigraph

with haptigraph.RunReader("../../tests/replay/golden/wrong_place_then_hit.mcap") as run:
    run.plot().savefig("run.png", dpi=80)
