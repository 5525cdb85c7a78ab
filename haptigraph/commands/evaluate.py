"""The command `evaluate`, which scores perception."""

import click

from haptigraph.commands.help import examples
from haptigraph.commands.options import config_option, procedure_option, set_option, settings_of, voxel_option
from haptigraph.commands.terminal import progress_bar
from haptigraph.errors import BadInput

__all__ = ["evaluate"]


@click.command(
    epilog=examples(
        "haptigraph evaluate clips/A_easy",
        "haptigraph evaluate clips/A_easy --perceiver threshold --json",
        "haptigraph evaluate --simulated 50 --figure accuracy.png",
        "haptigraph evaluate --volumes scans/needle --json",
    )
)
@click.argument("clip_dir", required=False)
@click.option(
    "--simulated", type=click.IntRange(min=1), metavar="N", help="Score N random simulated scenes instead."
)
@click.option(
    "--volumes",
    metavar="FOLDER",
    help="Score poses in labelled OCT volumes instead (documentation: Accuracy on volumes).",
)
@voxel_option
@click.option(
    "--perceiver",
    "perceivers",
    multiple=True,
    metavar="NAME",
    help="Perceiver to score, also MODULE:CLASS; with --simulated repeatable. Default: that of the settings; "
    "with --simulated, else all.",
)
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
    volumes: str | None,
    voxel_mm: tuple[float, float, float] | None,
    perceivers: tuple[str, ...],
    seed: int | None,
    as_recorded: bool,
    figure: str | None,
    procedure: str | None,
    config: str | None,
    settings: tuple[str, ...],
    as_json: bool,
) -> None:
    """Score perception and states on a labelled clip, on simulated scenes, or on labelled volumes.

    CLIP_DIR contains clip.mp4, registration.toml and truth.csv. With --simulated the moving average is off
    (perception.alpha=1) unless --set turns it on. With --volumes the instrument and the map to the labels are
    learned from every second volume in time, and the others are reported on.
    """
    import msgspec

    from haptigraph.config import load_config

    if volumes is not None:
        others = (
            clip_dir,
            simulated,
            *perceivers,
            seed,
            figure,
            procedure,
            config,
            *settings,
            as_recorded or None,
        )
        if any(other is not None for other in others):
            raise BadInput("--volumes goes with --voxel-mm and --json only")
        _evaluate_volumes(volumes, voxel_mm, as_json=as_json)
        return
    if voxel_mm is not None:
        raise BadInput("--voxel-mm goes with --volumes FOLDER")
    if (clip_dir is None) == (simulated is None):
        raise BadInput("evaluate takes either CLIP_DIR, --simulated N or --volumes FOLDER")
    if clip_dir is not None and (seed is not None or figure is not None):
        raise BadInput("--seed and --figure go with --simulated N")
    if clip_dir is None and as_recorded:
        raise BadInput("--as-recorded goes with CLIP_DIR")
    if clip_dir is not None and len(perceivers) > 1:
        raise BadInput("--perceiver is given more than once, which goes with --simulated N; a clip takes one")
    perceiver = perceivers[0] if perceivers else None
    given = (*settings, *settings_of({"perception.perceiver": perceiver, "run.procedure": procedure}))
    settled = load_config(config, given if clip_dir is not None else ("perception.alpha=1", *given))
    with progress_bar() as progress:
        if clip_dir is not None:
            from haptigraph.analysis.evaluation.report import report_clip

            report = report_clip(clip_dir, settled, progress, as_recorded=as_recorded)
        else:
            from haptigraph.analysis.evaluation.accuracy import report_simulated

            named = dict.fromkeys(perceivers or (settled.perception.perceiver,))
            report = report_simulated(
                simulated or 0,
                [name for name in named if name != "auto"],
                settled,
                seed=seed or 0,
                figure=figure,
                progress=progress,
            )
    if not as_json:
        click.echo(report.text)
        return
    from haptigraph.analysis.evaluation.origin import new_origin
    from haptigraph.assemble import load_procedure

    origin = new_origin(load_procedure(settled.run.procedure))
    click.echo(msgspec.json.encode({**report.scores, "origin": origin}).decode())


def _evaluate_volumes(folder: str, voxel_mm: tuple[float, float, float] | None, *, as_json: bool) -> None:
    import msgspec

    from haptigraph.analysis.evaluation.origin import new_origin
    from haptigraph.analysis.evaluation.volumes_report import report_volumes
    from haptigraph.perception.instrument.model import VOXEL_MM

    with progress_bar() as progress:
        report = report_volumes(folder, voxel_mm or VOXEL_MM, progress)
    if as_json:
        click.echo(msgspec.json.encode({**report.scores, "origin": new_origin()}).decode())
    else:
        click.echo(report.text)
