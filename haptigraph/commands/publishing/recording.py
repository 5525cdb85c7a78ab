"""The command that exports recordings to other programs: export."""

from collections.abc import Sequence
from pathlib import Path

import click

from haptigraph.commands.help import examples
from haptigraph.commands.terminal import progress_bar
from haptigraph.errors import BadInput

__all__ = ["export_recording"]

FORMATS = ("csv", "parquet", "mp4", "foxglove", "lerobot")


@click.command(
    "export",
    epilog=examples(
        "haptigraph export run.mcap --format csv -o exported",
        "haptigraph export recordings/*.mcap --format lerobot -o dataset",
        "haptigraph export run.mcap --format foxglove -o for-foxglove",
        "haptigraph export run.mcap --xdf run.xdf",
        "haptigraph export run.mcap --foxglove-layout haptigraph.json",
    ),
)
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.option(
    "--format",
    "kind",
    type=click.Choice(FORMATS),
    help="Tables, videos with overlay, MCAP for Foxglove and Rerun, or a dataset for LeRobot.",
)
@click.option("-o", "--output", metavar="FOLDER", help="The folder that --format creates.")
@click.option("--lossless", is_flag=True, help="With --format lerobot: keep every pixel of the images.")
@click.option("--xdf", metavar="FILE", help="The streams of the LSL bridge, as LabRecorder stores them.")
@click.option("--foxglove-layout", metavar="FILE", help="A layout of Foxglove that shows such recordings.")
def export_recording(
    recordings: tuple[str, ...],
    kind: str | None,
    output: str | None,
    lossless: bool,
    xdf: str | None,
    foxglove_layout: str | None,
) -> None:
    """Write every RECORDING, or what shows it, in the format of other programs.

    --format creates FOLDER with a file for each recording, and data_dictionary.csv: unit and meaning of every
    column. A dataset for LeRobot has an episode for each. All or nothing is written.

    An XDF file has the streams haptigraph.state, haptigraph.command and haptigraph.measures. Stamps are those
    of the recording, on the run's clock. A layout fits the recording, others of the same procedure, and the
    bridge foxglove. No file is overwritten.
    """
    if (kind is None) != (output is None):
        raise BadInput("--format and -o go together; for example --format csv -o exported")
    if lossless and kind != "lerobot":
        raise BadInput("--lossless goes with --format lerobot")
    if kind is None and xdf is None and foxglove_layout is None:
        raise BadInput("nothing to write; give --format and -o, --xdf FILE or --foxglove-layout FILE")
    if len(recordings) > 1 and (xdf or foxglove_layout):
        raise BadInput("--xdf and --foxglove-layout write one file; give one recording")
    for each in filter(None, (output, xdf, foxglove_layout)):
        if Path(each).exists():
            raise BadInput("exists already; choose another name", each)
    if foxglove_layout is not None:
        _export_layout(recordings[0], foxglove_layout)
    if xdf is not None:
        _export_xdf(recordings[0], xdf)
    if kind is not None and output is not None:
        _export_folder(recordings, kind, output, lossless)


def _export_layout(recording: str, output: str) -> None:
    from haptigraph.analysis.exporting.foxglove_layout import write_foxglove_layout

    write_foxglove_layout(recording, output)
    click.echo(f"{output}  import it in Foxglove: Layouts, Import from file")


def _export_xdf(recording: str, output: str) -> None:
    from haptigraph.analysis.exporting.xdf import run_xdf

    with progress_bar() as progress:
        counts = run_xdf(recording, output, progress)
    samples = ", ".join(f"{name} {count}" for name, count in counts.items())
    click.echo(f"{output}  samples: {samples}")


def _export_folder(recordings: Sequence[str], kind: str, output: str, is_lossless: bool) -> None:
    from haptigraph.analysis.exporting.runs import export_runs

    with progress_bar() as progress:
        about = export_runs(recordings, kind, output, progress, is_lossless=is_lossless)
    click.echo(f"{output}  {about}")
