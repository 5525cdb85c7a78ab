"""A proof as text: its claims in a table, and every graph that violates one, drawn with characters."""

from rich.table import Table

from haptigraph.analysis.words import counted
from haptigraph.graph import SceneGraph
from haptigraph.proof.report import Proof, Violation

__all__ = ["claims_table", "graph_text", "proof_summary"]


def claims_table(proof: Proof) -> Table:
    """Return the claims, each proved or violated, and the temporal ones, which are monitored during runs."""
    table = Table(title="Claims, over every possible graph", title_justify="left")
    for heading in ("", "claim", "statement"):
        table.add_column(heading, overflow="fold")
    for claim in proof.claims:
        exception = f"\n(not while held: {', '.join(claim.not_while_held)})" if claim.not_while_held else ""
        if claim.not_while_waiting:
            exception += f"\n(not while waiting for {', '.join(claim.not_while_waiting)})"
        table.add_row("proved" if claim.holds else "VIOLATED", claim.name, claim.statement + exception)
    for name in proof.monitored:
        table.add_row("monitored", "temporal", name)
    return table


def proof_summary(proof: Proof) -> str:
    """Return the outcome of a proof, with the violations and their graphs."""
    parts = [
        _violation_text(f"{claim.name}: {claim.statement}", violation)
        for claim in proof.claims
        for violation in claim.violations
    ]
    count = len(proof.violations)
    outcome = (
        f"all {len(proof.claims)} claims proved: {proof.method}"
        if proof.holds
        else f"{counted(count, 'violation')} ({proof.method})"
    )
    if proof.held_ms:
        held = ", ".join(f"{state} by {ms:g} ms" for state, ms in proof.held_ms.items())
        outcome += f"\nclaims concern graphs, not time: states that are held outlast their graphs, {held}"
    if proof.uncovered:
        outcome = "\n".join([outcome, "not covered:", *(f"  - {phrase}" for phrase in proof.uncovered)])
    return "\n\n".join([*parts, outcome])


def graph_text(graph: SceneGraph) -> str:
    """Draw a scene graph with characters: one line per edge, then isolated nodes, then measures."""
    lines = []
    predicate_width = max((len(edge.predicate) for edge in graph.edges), default=0)
    subject_width = max((len(edge.subject) for edge in graph.edges), default=0)
    previous = ""
    for edge in sorted(graph.edges, key=lambda edge: edge.subject):
        subject = edge.subject if edge.subject != previous else ""
        previous = edge.subject
        lines.append(f"{subject:>{subject_width}} ──{edge.predicate:─<{predicate_width}}──▶ {edge.object}")
    connected = {name for edge in graph.edges for name in (edge.subject, edge.object)}
    isolated = [node.id for node in graph.nodes if node.id not in connected]
    if isolated:
        lines.append(f"{'and ' if lines else ''}{', '.join(isolated)}")
    if graph.measures:
        values = ", ".join(
            f"{name} {value:.4g}" + (f" (standard deviation {sd:.2g})" if (sd := graph.sds.get(name)) else "")
            for name, value in graph.measures.items()
        )
        lines.append(f"for example with {values}")
    return "\n".join(lines) or "(an empty graph: nothing is detected)"


def _violation_text(claim: str, violation: Violation) -> str:
    lines = [f"VIOLATED  {claim}", f"  {violation.sentence}"]
    if violation.graph is not None:
        lines.append(
            "  the smallest graph that breaks it:" if violation.is_possible else "  impossible graph:"
        )
        lines += [f"    {line}" for line in graph_text(violation.graph).splitlines()]
    if violation.still_holding:
        lines.append(
            f"    {' and '.join(violation.still_holding)} held over from the previous image (release)"
        )
    return "\n".join(lines)
