"""The command that exports a recording to other programs: export."""

from pathlib import Path

import click

from haptigraph.commands.help import examples
from haptigraph.commands.terminal import progress_bar
from haptigraph.errors import BadInput

__all__ = ["export_recording"]


@click.command(
    "export",
    epilog=examples(
        "haptigraph export run.mcap --xdf run.xdf",
        "haptigraph export run.mcap --foxglove-layout haptigraph.json",
    ),
)
@click.argument("recording")
@click.option("--xdf", metavar="FILE", help="The streams of the LSL bridge, as LabRecorder stores them.")
@click.option("--foxglove-layout", metavar="FILE", help="A layout of Foxglove that shows such recordings.")
def export_recording(recording: str, xdf: str | None, foxglove_layout: str | None) -> None:
    """Write RECORDING, or what shows it, in the format of another program.

    An XDF file has the streams haptigraph.state, haptigraph.command and haptigraph.measures. Stamps are those
    of the recording, on the run's clock. A layout fits the recording, others of the same procedure, and the
    bridge foxglove. No file is overwritten.
    """
    if xdf is None and foxglove_layout is None:
        raise BadInput("nothing to write; give --xdf FILE or --foxglove-layout FILE")
    for output in filter(None, (xdf, foxglove_layout)):
        if Path(output).exists():
            raise BadInput("exists already; choose another name", output)
    if foxglove_layout is not None:
        from haptigraph.analysis.exporting.foxglove_layout import write_foxglove_layout

        write_foxglove_layout(recording, foxglove_layout)
        click.echo(f"{foxglove_layout}  import it in Foxglove: Layouts, Import from file")
    if xdf is not None:
        from haptigraph.analysis.exporting.xdf import run_xdf

        with progress_bar() as progress:
            counts = run_xdf(recording, xdf, progress)
        samples = ", ".join(f"{name} {count}" for name, count in counts.items())
        click.echo(f"{xdf}  samples: {samples}")
