"""The command `evaluate`, which scores perception."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.commands.options import config_option, procedure_option, set_option, settings_of, voxel_option
from haptigraph.commands.terminal import progress_bar
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from haptigraph.analysis.evaluation.report import Report
    from haptigraph.inference.procedure import Procedure

__all__ = ["evaluate"]


@click.command(
    epilog=examples(
        "haptigraph evaluate clips/A_easy",
        "haptigraph evaluate clips/A_easy --perceiver threshold --json",
        "haptigraph evaluate run.mcap",
        "haptigraph evaluate --simulated 50 --figure accuracy.png",
        "haptigraph evaluate --volumes scans/needle --json",
    )
)
@click.argument("clip_dir", metavar="[CLIP_DIR|RECORDING]", required=False)
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
    help="Perceiver to score, also MODULE:CLASS; with --simulated repeatable, not with RECORDING. Default: "
    "that of the settings; with --simulated, else all.",
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
    """Score perception on a labelled clip, a simulated recording, simulated scenes, or labelled volumes.

    CLIP_DIR contains clip.mp4, registration.toml and truth.csv. A RECORDING of a simulated eye contains its
    ground truth; tips at least 2 mm deep are scored, perceived anew with the settings of the run. With
    --simulated the moving average is off (perception.alpha=1) unless --set turns it on. With --volumes the
    instrument and the map to the labels are learned from every second volume in time, and the others are
    reported on.
    """
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
    if clip_dir is not None and Path(clip_dir).suffix == ".mcap":
        others = (simulated, *perceivers, seed, figure, config, *settings, as_recorded or None)
        if any(other is not None for other in others):
            raise BadInput(
                "a recording is scored with its own settings, and goes with --procedure and --json; for "
                "others record it anew: haptigraph run RECORDING --fast --set KEY=VALUE --record NEW.mcap"
            )
        _evaluate_recording(clip_dir, procedure, as_json=as_json)
        return
    if (clip_dir is None) == (simulated is None):
        raise BadInput("evaluate takes either CLIP_DIR, RECORDING, --simulated N or --volumes FOLDER")
    if clip_dir is not None:
        _check_for_clip(seed, figure, perceivers)
    elif as_recorded:
        raise BadInput("--as-recorded goes with CLIP_DIR")
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
    from haptigraph.assemble import load_procedure

    _print(report, load_procedure(settled.run.procedure), as_json=as_json)


def _check_for_clip(seed: int | None, figure: str | None, perceivers: tuple[str, ...]) -> None:
    """Refuse options that have no meaning for a clip."""
    if seed is not None or figure is not None:
        raise BadInput("--seed and --figure go with --simulated N")
    if len(perceivers) > 1:
        raise BadInput("--perceiver is given more than once, which goes with --simulated N; a clip takes one")


def _evaluate_recording(recording: str, name: str | None, *, as_json: bool) -> None:
    from haptigraph.analysis.batch.scoring import report_recording
    from haptigraph.analysis.metrics.replay import recorded_procedure
    from haptigraph.assemble import load_procedure
    from haptigraph.recording.reader import RunReader

    reader = RunReader(recording)
    procedure = load_procedure(name) if name else recorded_procedure(reader)
    with progress_bar() as progress:
        report = report_recording(reader, procedure, progress)
    _print(report, procedure, as_json=as_json)


def _evaluate_volumes(folder: str, voxel_mm: tuple[float, float, float] | None, *, as_json: bool) -> None:
    from haptigraph.analysis.evaluation.volumes_report import report_volumes
    from haptigraph.perception.instrument.model import VOXEL_MM

    with progress_bar() as progress:
        report = report_volumes(folder, voxel_mm or VOXEL_MM, progress)
    _print(report, None, as_json=as_json)


def _print(report: "Report", procedure: "Procedure | None", *, as_json: bool) -> None:
    """Print the report as a table, or as JSON with its origin."""
    import msgspec

    from haptigraph.analysis.evaluation.origin import new_origin

    if as_json:
        click.echo(msgspec.json.encode({**report.scores, "origin": new_origin(procedure)}).decode())
    else:
        click.echo(report.text)
