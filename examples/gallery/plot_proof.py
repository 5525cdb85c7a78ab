"""
Where a procedure breaks its claims
===================================

A procedure whose alarm is silent violates a claim. The figure shows graphs in which that happens.
"""

from pathlib import Path
from tempfile import mkdtemp

import haptigraph
from haptigraph.analysis.plots.proof_figure import proof_figure
from haptigraph.proof.prove import prove

text = haptigraph.load_procedure("subretinal_injection").text.replace('feel = "pulse"', 'feel = "off"')
path = Path(mkdtemp()) / "silent.toml"
path.write_text(text, encoding="utf-8")
procedure = haptigraph.load_procedure(str(path))
proof_figure(procedure, prove(procedure), "proof.png")
