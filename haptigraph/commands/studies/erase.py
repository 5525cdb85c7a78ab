"""The command that erases the data of a participant who withdraws consent: study erase."""

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.commands.study import existing_store, missing_store, store_option
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from haptigraph.study.erasure import ParticipantData

__all__ = ["erase"]


@click.command(
    epilog=examples(
        "haptigraph study erase my-study P07 --dry-run",
        "haptigraph study erase my-study P07",
    )
)
@click.argument("folder")
@click.argument("participant")
@click.option("--yes", is_flag=True, help="Do not ask for confirmation; for scripts.")
@click.option("--dry-run", is_flag=True, help="List what would be erased, without erasing it.")
@store_option
def erase(folder: str, participant: str, yes: bool, dry_run: bool, store: str | None) -> None:
    """Erase the data of a participant who withdraws consent.

    Permanently deletes answers, trials, sessions, notes and recordings of PARTICIPANT from the store and the
    study's FOLDER. Pseudonym and slot stay, so that the others' orders do not change. Run it again after an
    interruption, and at every station that stores recordings of its own.
    """
    from haptigraph.study.protocol import load_protocol

    protocol = load_protocol(folder)
    with existing_store(folder, store) as opened:
        if opened is None:
            raise missing_store(folder)
        from haptigraph.study import erasure
        from haptigraph.study.roster import study_in

        study = study_in(opened, protocol)
        data = erasure.find_data(study, participant)
        has_data = bool(data.rows or data.files or not data.erased_utc)
        if has_data and not (yes or dry_run or sys.stdin.isatty()):
            raise BadInput(
                f"erasing {participant} cannot be undone and needs confirmation at a terminal; give --yes to "
                f"confirm, or --dry-run to list what would be erased"
            )
        what = "would be erased" if dry_run else "to be erased"
        for line in _listed(participant, data, what) if has_data else _bundles(data):
            click.echo(line)
        if dry_run:
            click.echo("nothing was erased" if has_data else f"no data of {participant} are left here")
            return
        if has_data and not yes and not click.confirm(f"Erase all data of {participant} permanently?"):
            click.echo("nothing was erased")
            sys.exit(1)
        erasure.erase(study, participant)
    click.echo(f"{participant} is erased" if has_data else f"no data of {participant} are left here")


def _listed(participant: str, data: "ParticipantData", what: str) -> Iterator[str]:
    """Yield what is erased, what stays, and what the user must delete or renew."""
    rows = ", ".join(f"{table} {count}" for table, count in data.rows.items()) or "none"
    yield f"{participant}: {what}"
    yield f"  rows of the store: {rows}" + ("" if data.erased_utc else "; times of enrolment and consent")
    yield from (f"  {file}" for file in data.files)
    yield f"retained: the pseudonym, which is not reused, and place {data.slot + 1} in the counterbalancing"
    if data.elsewhere:
        yield f"not in recordings/{participant} here; run this again at the station that has them"
        yield from (f"  {path}" for path in data.elsewhere)
    if data.aggregates:
        yield "contain all participants; delete them, then create them again"
        yield from (f"  {folder}" for folder in data.aggregates)
    yield from _bundles(data)
    yield "delete or renew exports, reports, copies and backups elsewhere yourself"


def _bundles(data: "ParticipantData") -> Iterator[str]:
    """Yield the bundles that an erasure does not reach."""
    if data.bundles:
        yield "bundles that contain these data; delete or replace them wherever they are published"
        yield from (f"  {bundle}" for bundle in data.bundles)
