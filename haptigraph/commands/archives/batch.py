"""The command `batch`: one job on all recordings below a folder."""

import time
from pathlib import Path

import click

from haptigraph.commands.help import examples
from haptigraph.commands.spreading import cluster_of, cluster_options, usable_cores, workers_option
from haptigraph.commands.terminal import progress_bar, terminable
from haptigraph.errors import BadInput

__all__ = ["batch"]

KINDS = ("replay", "measure", "evaluate", "export")
FORMATS = ("csv", "parquet", "mp4", "foxglove")


@click.command(
    epilog=examples(
        "haptigraph batch replay recordings -o replayed --procedure subretinal_injection_steady",
        "haptigraph batch measure recordings -o measured --workers 4",
        "haptigraph batch export recordings -o tables --format parquet",
    )
)
@click.argument("kind", type=click.Choice(KINDS), metavar="replay|measure|evaluate|export")
@click.argument("folder")
@click.option("-o", "--output", required=True, metavar="OUT", help="The folder of results; resumed if there.")
@click.option(
    "--procedure", default="", metavar="NAME|FILE", help="Another procedure to apply; default: the recorded."
)
@click.option(
    "--format",
    "kind_of_file",
    type=click.Choice(FORMATS),
    default="csv",
    show_default=True,
    help="Of the files that an export writes.",
)
@click.option("--page", metavar="ADDRESS", help="Of the recordings page that the report links to.")
@workers_option
@cluster_options
def batch(
    kind: str,
    folder: str,
    output: str,
    procedure: str,
    kind_of_file: str,
    page: str | None,
    workers: int | None,
    cluster: str | None,
    tls: str | None,
) -> None:
    """Do one job on all recordings below FOLDER, and report on them together.

    replay: what this version, or another procedure, would have done. measure: the measures of each run; needs
    haptigraph[study]. evaluate: the errors of perception, in simulated recordings. export: a table or a video
    of each.

    OUT receives report.html and recordings.csv. A damaged recording is reported and passed over. After an
    interruption, run it again to resume: recordings that have not changed are not done again. The
    report is written anew each time.
    """
    from haptigraph.analysis.batch.batch import Batch, run_batch
    from haptigraph.analysis.batch.report import write_report
    from haptigraph.analysis.metrics.page_address import PAGE, page_command
    from haptigraph.analysis.words import counted

    if procedure and kind in ("measure", "export"):
        raise BadInput(f"--procedure goes with replay and evaluate; {kind} takes the runs as recorded")
    spec = Batch(kind, Path(folder), Path(output), procedure, kind_of_file)  # type: ignore[arg-type]
    start_s = time.perf_counter()
    with terminable(), progress_bar() as progress:
        ran = run_batch(
            spec,
            workers=workers or usable_cores(),
            cluster=cluster_of(cluster, tls),
            progress=progress,
        )
    lines = write_report(spec, page or PAGE)
    took_s = time.perf_counter() - start_s
    click.echo(f"{counted(ran.now, 'recording')} now, in {took_s:.0f} s; {ran.before} done before")
    if ran.being_written:
        click.echo(f"{counted(ran.being_written, 'recording')} left for later: still being recorded")
    for line in lines:
        click.echo(line)
    click.echo(f"{Path(output) / 'report.html'}  its links need: {page_command(folder)}")
