"""The command `evaluate`, which scores perception."""

import click

from haptigraph.commands.help import examples
from haptigraph.commands.options import config_option, procedure_option, set_option, settings_of
from haptigraph.commands.terminal import progress_bar
from haptigraph.errors import BadInput

__all__ = ["evaluate"]


@click.command(
    epilog=examples(
        "haptigraph evaluate clips/A_easy",
        "haptigraph evaluate clips/A_easy --perceiver threshold --json",
        "haptigraph evaluate --simulated 50 --figure accuracy.png",
    )
)
@click.argument("clip_dir", required=False)
@click.option(
    "--simulated", type=click.IntRange(min=1), metavar="N", help="Score N random simulated scenes instead."
)
@click.option("--perceiver", metavar="NAME", help="Perceiver to score; with --simulated the default is all.")
@click.option("--seed", type=click.IntRange(min=0), help="Random seed of the simulated scenes.")
@click.option(
    "--as-recorded",
    is_flag=True,
    help="Pass the clip's images through JPEG first (source.jpeg_quality), as those of a camera are.",
)
@click.option("--figure", metavar="FILE", help="Plot the errors on simulated scenes: PNG, SVG or PDF.")
@procedure_option
@config_option
@set_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def evaluate(
    clip_dir: str | None,
    simulated: int | None,
    perceiver: str | None,
    seed: int | None,
    as_recorded: bool,
    figure: str | None,
    procedure: str | None,
    config: str | None,
    settings: tuple[str, ...],
    as_json: bool,
) -> None:
    """Score perception and states on a labelled clip, or on simulated scenes.

    CLIP_DIR contains clip.mp4, registration.toml and truth.csv. With --simulated the moving average is off
    (perception.alpha=1) unless --set turns it on.
    """
    import msgspec

    from haptigraph.config import load_config

    given = (*settings, *settings_of({"perception.perceiver": perceiver, "run.procedure": procedure}))
    if (clip_dir is None) == (simulated is None):
        raise BadInput("evaluate takes either CLIP_DIR or --simulated N")
    if clip_dir is not None and (seed is not None or figure is not None):
        raise BadInput("--seed and --figure go with --simulated N")
    if clip_dir is None and as_recorded:
        raise BadInput("--as-recorded goes with CLIP_DIR")
    settled = load_config(config, given if clip_dir is not None else ("perception.alpha=1", *given))
    with progress_bar() as progress:
        if clip_dir is not None:
            from haptigraph.analysis.evaluation.report import report_clip

            report = report_clip(clip_dir, settled, progress, as_recorded=as_recorded)
        else:
            from haptigraph.analysis.evaluation.accuracy import report_simulated

            report = report_simulated(
                simulated or 0, perceiver, settled, seed=seed or 0, figure=figure, progress=progress
            )
    if not as_json:
        click.echo(report.text)
        return
    from haptigraph.analysis.evaluation.origin import new_origin
    from haptigraph.assemble import load_procedure

    origin = new_origin(load_procedure(settled.run.procedure))
    click.echo(msgspec.json.encode({**report.scores, "origin": origin}).decode())
