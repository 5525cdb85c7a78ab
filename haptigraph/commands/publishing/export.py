"""The command that exports a study: study export, as complete tables or as a bundle to publish."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.commands.study import (
    export_measured,
    folder_argument,
    measured_study,
    store_option,
)
from haptigraph.commands.terminal import print_status, progress_bar
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from haptigraph.analysis.study.bundle.readme import Contents

__all__ = ["export"]


@click.command(
    epilog=examples(
        "haptigraph study export my-study -o exported",
        "haptigraph study export my-study --osf -o bundle --without age_years",
    )
)
@folder_argument
@click.option("-o", "--output", metavar="FOLDER", required=True, help="The folder to create.")
@click.option("--parquet", is_flag=True, help="Also write the tables as Parquet; needs haptigraph[parquet].")
@click.option("--osf", is_flag=True, help="Write a bundle to publish, without what identifies participants.")
@click.option(
    "--without",
    multiple=True,
    metavar="COLUMN",
    help="With --osf: omit a column of participants; repeatable.",
)
@store_option
def export(
    folder: str, output: str, parquet: bool, osf: bool, without: tuple[str, ...], store: str | None
) -> None:
    """Write tidy CSV with a data dictionary, or a bundle to publish, for example on OSF.

    Measures that are missing are computed from the recordings first. A bundle has new random names instead
    of pseudonyms; FOLDER/bundles.json alone links the two. It omits notes, and free text and recordings
    unless the participant has allowed them in the questionnaire `sharing`. Its reproduce.py makes the report
    again.
    """
    if osf and parquet:
        raise BadInput("a bundle has its tables as CSV alone; give --osf or --parquet")
    if without and not osf:
        raise BadInput("--without goes with --osf; any other export is complete")
    if osf:
        _export_bundle(folder, store, output, without)
        return
    with progress_bar() as progress:
        export_measured(folder, store, output, progress, parquet=parquet)
    click.echo(f"{output}  data_dictionary.csv describes every column")


def _export_bundle(folder: str, store: str | None, output: str, without: Sequence[str]) -> None:
    """Compute missing measures, write the bundle, and say what it lacks and whom it may reveal."""
    from haptigraph.analysis.study.bundle.bundle import write_bundle
    from haptigraph.study.roster import study_in

    with progress_bar() as progress, measured_study(folder, store, output, progress) as study:
        opened, protocol, problems = study
        written = write_bundle(study_in(opened, protocol), Path(output), without, progress)
    for problem in dict.fromkeys([*problems, *written.problems]):
        print_status(f"haptigraph: {problem}")
    _print_contents(written.contents)
    click.echo(
        f"{output}  participants: {written.contents.participants}; read its README.md before you publish"
    )


def _print_contents(contents: "Contents") -> None:
    for what, count in contents.left_out.items():
        click.echo(f"left out: {what}: {count}")
    if contents.contacts:
        click.echo(f"replaced: contacts in the protocol's texts: {contents.contacts}")
    columns, people = contents.unique
    if people:
        print_status(
            f"haptigraph: {len(people)} of {contents.participants} participants: nobody else has their "
            f"combination of {', '.join(columns)}; who knows it finds their data. They are "
            f"{', '.join(people)}; leave columns out with --without COLUMN"
        )
