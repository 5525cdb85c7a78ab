"""The command for a participant who withdraws consent: study erase."""

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from haptigraph.commands.study import existing_store, no_store, store_option
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from haptigraph.study.erasure import Found

__all__ = ["erase"]


@click.command()
@click.argument("folder")
@click.argument("participant")
@click.option("--yes", is_flag=True, help="Do not ask; for scripts.")
@click.option("--dry-run", is_flag=True, help="List what would go, and leave it there.")
@store_option
def erase(folder: str, participant: str, yes: bool, dry_run: bool, store: str | None) -> None:
    """Erase a participant who withdraws consent.

    Answers, trials, sessions, notes and recordings of PARTICIPANT go for good, from the store and from the
    study's FOLDER. Pseudonym and place in the balancing stay, so that the others' orders do not change. Run
    it again where it was cut off, and at every station that keeps recordings of its own.
    """
    from haptigraph.study.protocol import load_protocol

    protocol = load_protocol(folder)
    with existing_store(folder, store) as kept:
        if kept is None:
            raise no_store(folder)
        from haptigraph.study import erasure
        from haptigraph.study.roster import study_in

        study = study_in(kept, protocol)
        found = erasure.find(study, participant)
        goes = bool(found.rows or found.files or not found.erased_utc)
        if goes and not (yes or dry_run or sys.stdin.isatty()):
            raise BadInput(
                f"erasing {participant} cannot be undone, and nobody is here to be asked; give --yes to do "
                f"it, --dry-run to see what would go"
            )
        for line in _listed(participant, found) if goes else ():
            click.echo(line)
        if dry_run:
            click.echo("nothing was erased" if goes else f"nothing of {participant} is left here")
            return
        if goes and not yes and not click.confirm(f"Erase {participant} for good?"):
            click.echo("nothing was erased")
            sys.exit(1)
        erasure.erase(study, participant)
    click.echo(f"{participant} is erased" if goes else f"nothing of {participant} is left here")


def _listed(participant: str, found: "Found") -> Iterator[str]:
    """Yield what goes, what stays, and what is not ours to erase."""
    rows = ", ".join(f"{table} {count}" for table, count in found.rows.items()) or "none"
    yield f"{participant}: what goes"
    yield f"  rows of the store: {rows}" + ("" if found.erased_utc else "; times of taking in and consent")
    yield from (f"  {file}" for file in found.files)
    yield f"what stays: the pseudonym, which is not given again, and place {found.slot + 1} with its order"
    if found.elsewhere:
        yield f"not in recordings/{participant} here; run this again at the station that has them"
        yield from (f"  {path}" for path in found.elsewhere)
    if found.made_of_all:
        yield "made of all participants; to be made anew"
        yield from (f"  {folder}" for folder in found.made_of_all)
    yield "exports, reports, copies and backups elsewhere are yours to make anew or delete"
