"""Figure of the graphs that violate the claims about a procedure."""

import textwrap
from pathlib import Path

from haptigraph.analysis.evaluation.sweep_figure import check_output
from haptigraph.analysis.plots.scene_graph import draw_graph
from haptigraph.errors import BadInput
from haptigraph.figures import ConstrainedLayoutEngine, Figure
from haptigraph.inference.colors import palette
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.report import Proof

__all__ = ["proof_figure"]

MAX_GRAPHS = 12
"""Graphs in one figure; the text report lists all."""


def proof_figure(procedure: Procedure, proof: Proof, output: str | Path) -> None:
    """Draw every violated claim with its graph to a new PNG, SVG or PDF file; one sentence if there is none.

    Raises:
        BadInput: If the file exists, or the format is unknown.
    """
    path, paints = Path(output), palette(procedure)
    check_output(path)
    if path.exists():
        raise BadInput("exists already; delete it or give another name", path)
    shown = [
        (claim, violation)
        for claim in proof.claims
        for violation in claim.violations
        if violation.graph is not None
    ][:MAX_GRAPHS]
    columns = min(len(shown), 2) or 1
    rows = -(-len(shown) // columns) or 1
    layout = ConstrainedLayoutEngine(hspace=0.08, h_pad=0.15)
    figure = Figure(figsize=(6.4 * columns, 4.6 * rows if shown else 1.2), layout=layout)
    all_axes = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for axes in all_axes:
        axes.axis("off")
    if not shown:
        outcome = f"all {len(proof.claims)} claims proved" if proof.holds else "no graph to show"
        all_axes[0].set_title(f"{proof.procedure}: {outcome}")
    for axes, (claim, violation) in zip(all_axes, shown, strict=False):
        graph, paint = violation.graph, paints[violation.state]
        if graph is not None:
            draw_graph(axes, graph)
        parts = (f"{claim.name}: {claim.statement}", violation.sentence)
        title = "\n".join(line for part in parts for line in textwrap.wrap(part, 84))
        axes.set_title(title, fontsize=8.5, loc="left")
        label = violation.state.replace("_", " ") if violation.is_possible else "impossible"
        axes.text(
            0.5, 0.0, label, transform=axes.transAxes, ha="center", fontsize=9, color=paint.ink,
            bbox={"boxstyle": "round", "facecolor": paint.color, "edgecolor": "#555"},
        )  # fmt: skip
    figure.savefig(path, dpi=120)
