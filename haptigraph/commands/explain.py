"""Commands that explain a moment of a run (explain) and the states of a procedure (diagram)."""

import click

from haptigraph.commands.help import examples

__all__ = ["diagram", "explain"]


@click.command(epilog=examples("haptigraph explain run.mcap --at 12.4"))
@click.argument("recording")
@click.option("--at", "at_s", type=float, required=True, metavar="SECONDS", help="Time since the first step.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def explain(recording: str, at_s: float, as_json: bool) -> None:
    """Explain one moment of RECORDING: the rule that fired, its evidence, and the nearest other state.

    For every other state it shows the shortest motion of the needle that leads there: a turn about the
    trocar, then a motion along the shaft, with the states on the way. The runner-up is the nearest. Without
    a needle, or for forceps and B-scans, it shows the smallest change of measures instead.
    """
    import msgspec

    from haptigraph.analysis.metrics.moment import explain_moment, explanation_text

    explanation = explain_moment(recording, at_s)
    click.echo(msgspec.json.encode(explanation).decode() if as_json else explanation_text(explanation))


@click.command(epilog=examples("haptigraph diagram subretinal_injection -o states.svg"))
@click.argument("procedure", default="subretinal_injection")
@click.option("-o", "--output", metavar="FILE", required=True, help="The SVG to write.")
def diagram(procedure: str, output: str) -> None:
    """Draw the states of PROCEDURE with their priorities, as in the paper.

    Misaligned states are on the left, aligned ones on the right. A line joins two states if one measure
    crossing one threshold can lead from one to the other.
    """
    from haptigraph.analysis.plots.diagram import write_diagram
    from haptigraph.assemble import load_procedure

    write_diagram(load_procedure(procedure), output)
    click.echo(output)
