"""A proof as text: its claims in a table, and every graph that breaks one, drawn in letters."""

from rich.table import Table

from haptigraph.graph import SceneGraph
from haptigraph.proof.report import Proof, Violation

__all__ = ["claims_table", "graph_text", "told"]


def claims_table(proof: Proof) -> Table:
    """Return the claims, each proved or violated, and those that only runs can keep."""
    table = Table(title="Claims, over every possible graph", title_justify="left")
    for heading in ("", "claim", "says"):
        table.add_column(heading, overflow="fold")
    for claim in proof.claims:
        but = f"\n(not while held: {', '.join(claim.not_while_held)})" if claim.not_while_held else ""
        table.add_row("proved" if claim.holds else "VIOLATED", claim.name, claim.says + but)
    for name in proof.watched:
        table.add_row("watched", "temporal", name)
    return table


def told(proof: Proof) -> str:
    """Say how a proof ended; violated claims with what breaks them."""
    parts = [
        _told(f"{claim.name}: {claim.says}", violation)
        for claim in proof.claims
        for violation in claim.violations
    ]
    count = len(proof.violations)
    ended = (
        f"all {len(proof.claims)} claims proved: {proof.method}"
        if proof.holds
        else f"{count} violation{'s' if count > 1 else ''} ({proof.method})"
    )
    if proof.held_ms:
        held = ", ".join(f"{state} by {ms:g} ms" for state, ms in proof.held_ms.items())
        ended += f"\nclaims are about graphs, not about time: states that are held outlast theirs, {held}"
    return "\n\n".join([*parts, ended])


def graph_text(graph: SceneGraph) -> str:
    """Draw a scene graph in letters: a line an edge, then who else is there, then the measures."""
    lines = []
    longest = max((len(edge.predicate) for edge in graph.edges), default=0)
    width = max((len(edge.subject) for edge in graph.edges), default=0)
    before = ""
    for edge in sorted(graph.edges, key=lambda edge: edge.subject):
        subject = edge.subject if edge.subject != before else ""
        before = edge.subject
        lines.append(f"{subject:>{width}} ──{edge.predicate:─<{longest}}──▶ {edge.object}")
    joined = {name for edge in graph.edges for name in (edge.subject, edge.object)}
    alone = [node.id for node in graph.nodes if node.id not in joined]
    if alone:
        lines.append(f"{'and ' if lines else ''}{', '.join(alone)}")
    if graph.measures:
        values = ", ".join(f"{name} {value:.4g}" for name, value in graph.measures.items())
        lines.append(f"for example where {values}")
    return "\n".join(lines) or "(an empty graph: nothing is seen)"


def _told(claim: str, violation: Violation) -> str:
    lines = [f"VIOLATED  {claim}", f"  {violation.sentence}"]
    if violation.graph is not None:
        lines.append("  the smallest graph that breaks it:" if violation.is_possible else "  what cannot be:")
        lines += [f"    {line}" for line in graph_text(violation.graph).splitlines()]
    if violation.still_holding:
        lines.append(f"    {' and '.join(violation.still_holding)} still from the image before (release)")
    return "\n".join(lines)
