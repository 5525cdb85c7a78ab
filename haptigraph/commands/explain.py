"""Commands that explain or show: a moment of a run, its figures, a procedure's states, its evidence."""

import sys
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.commands.terminal import progress_bar

if TYPE_CHECKING:
    from haptigraph.analysis.paper.figure import Kind

__all__ = ["diagram", "evidence", "explain", "figure"]


@click.command(epilog=examples("haptigraph explain run.mcap", "haptigraph explain run.mcap --at 12.4"))
@click.argument("recording")
@click.option(
    "--at",
    "at_s",
    type=float,
    metavar="SECONDS",
    help="Time since the first step; without it, what the whole recording is.",
)
@click.option("--all", "has_all", is_flag=True, help="Show what leads to every other state.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def explain(recording: str, at_s: float | None, has_all: bool, as_json: bool) -> None:
    """Explain one moment of RECORDING: the rule that fired, its evidence, and the nearest other state.

    Without --at it says what RECORDING is: when, by which version, from which source, with which procedure
    and settings it was recorded, how long it is, and what failed.

    The runner-up is the nearest other state, with the shortest motion of the needle that leads there: a turn
    about the trocar, then a motion along the shaft, with the states on the way. Without a needle, or for
    forceps and B-scans, it is the one with the smallest change of measures. It names what had failed at that
    moment, such as the haptic device, and since when.
    """
    import msgspec

    from haptigraph.analysis.archive.about import about_lines, about_recording
    from haptigraph.analysis.metrics.moment import explain_moment, explanation_text

    if at_s is None:
        with progress_bar() as progress:
            about = about_recording(recording, progress)
        click.echo(msgspec.json.encode(about).decode() if as_json else "\n".join(about_lines(about)))
        return
    explanation = explain_moment(recording, at_s)
    text = explanation_text(explanation, has_all=has_all)
    click.echo(msgspec.json.encode(explanation).decode() if as_json else text)


@click.command(
    epilog=examples(
        "haptigraph diagram subretinal_injection -o states.svg",
        "haptigraph diagram phantom:wrong_place_then_hit -o scenario.svg",
    )
)
@click.argument("subject", metavar="PROCEDURE|phantom:SCENARIO", default="subretinal_injection")
@click.option("-o", "--output", metavar="FILE", required=True, help="The SVG to write.")
def diagram(subject: str, output: str) -> None:
    """Draw the states of PROCEDURE with their priorities, or the eye and the moves of SCENARIO.

    States with a misaligned needle are on the left, with an aligned one on the right; states with many
    neighbours are one below the other. A line or a dot joins two states if one measure crossing one threshold
    can lead from one to the other.
    """
    from haptigraph.analysis.plots.svg import write_svg

    write_svg(_diagram_svg(subject), output)
    click.echo(output)


def _diagram_svg(subject: str) -> str:
    from haptigraph.analysis.plots.diagram import diagram_svg
    from haptigraph.analysis.plots.scenario_diagram import scenario_svg
    from haptigraph.assemble import load_procedure
    from haptigraph.sim.scenario import load_scenario

    if subject.startswith("phantom:"):
        return scenario_svg(load_scenario(subject.removeprefix("phantom:")))
    return diagram_svg(load_procedure(subject))


@click.command(
    epilog=examples(
        "haptigraph evidence subretinal_injection -o evidence",
        "haptigraph evidence my.toml --faults faults.jsonl --evaluation accuracy.json --run run.mcap -o out",
    )
)
@click.argument("procedure", default="subretinal_injection")
@click.option("--faults", metavar="RESULT", help="Results of a campaign of faults (`make faults`).")
@click.option(
    "--evaluation",
    "evaluations",
    multiple=True,
    metavar="RESULT",
    help="Output of `haptigraph evaluate --json`; repeatable.",
)
@click.option(
    "--run", "runs", multiple=True, metavar="RECORDING", help="Recording of a run of PROCEDURE; repeatable."
)
@click.option("-o", "--output", metavar="OUT", required=True, help="Folder to write; created if missing.")
def evidence(
    procedure: str, faults: str | None, evaluations: tuple[str, ...], runs: tuple[str, ...], output: str
) -> None:
    """Write the evidence for what PROCEDURE claims, by hazard, for an ethics application or a risk file.

    OUT receives evidence.html, evidence.md, evidence.csv and argument.svg. Proofs are made now; results count
    if they are about this procedure and this software. Exit code 1 if a claim's evidence fails or is missing.
    """
    from haptigraph.analysis.evidence.gathering import Results, safety_case
    from haptigraph.analysis.evidence.tables import outcome, status_text
    from haptigraph.analysis.evidence.writing import check_folder, write_case

    folder = check_folder(output)
    with progress_bar() as progress:
        case = safety_case(procedure, Results(faults, evaluations, runs), progress)
    write_case(case, folder)
    for _, _, _, claim, number, each in case.rows():
        if claim.lacks(each):
            click.echo(f"{number} {status_text(claim, each)}: {claim.statement} ({each.figure})")
    click.echo(f"{outcome(case)}; open {folder / 'evidence.html'}")
    if not case.holds:
        sys.exit(1)


@click.command(
    epilog=examples(
        "haptigraph figure run.mcap --kind timeline -o timeline.pdf",
        "haptigraph figure run.mcap --kind timeline --procedure own.toml -o compared.png",
        "haptigraph figure run.mcap --kind pipeline --at 9.5 -o pipeline.pdf",
        "haptigraph figure run.mcap --kind views -o views.svg",
    )
)
@click.argument("recording")
@click.option(
    "--kind",
    type=click.Choice(["pipeline", "views", "timeline"]),
    required=True,
    help="pipeline: every stage of perception on one image, the paper's and the tracker's; views: raw image, "
    "displayed picture, trigger zones; timeline: states, measures and haptic output over time.",
)
@click.option(
    "--at",
    "at_s",
    type=float,
    metavar="SECONDS",
    help="Moment of pipeline and views, since the first step; default: the longest alarm.",
)
@click.option(
    "--procedure",
    metavar="NAME|FILE",
    help="Another procedure: a timeline also shows its states and its haptic output.",
)
@click.option("-o", "--output", metavar="FILE", required=True, help="PDF, SVG or PNG to write.")
def figure(recording: str, kind: "Kind", at_s: float | None, procedure: str | None, output: str) -> None:
    """Draw a figure of RECORDING for a paper: two columns wide (183 mm), vector graphics, fonts embedded."""
    from haptigraph.analysis.paper.figure import paper_figure

    with progress_bar() as progress:
        paper_figure(recording, kind, output, at_s, procedure, progress)
    click.echo(output)
