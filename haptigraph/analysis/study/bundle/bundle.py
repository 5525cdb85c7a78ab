"""Write a study as a bundle: what may be published of it, the report, and what reproduces that."""

import shutil
from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.study.bundle import reproduce
from haptigraph.analysis.study.bundle.environment import environment, requirements
from haptigraph.analysis.study.bundle.readme import Contents, readme
from haptigraph.analysis.study.report import write_report
from haptigraph.checksum import sha256_of
from haptigraph.errors import BadInput
from haptigraph.folders import new_folder
from haptigraph.recording.writer import Progress
from haptigraph.study.checksums import CHECKSUMS, write_checksums
from haptigraph.study.exchange.exporting import About, about_study, tidy_tables, write_tables
from haptigraph.study.recordings import recording_problem
from haptigraph.study.roster import Study
from haptigraph.study.sharing.preregistration import preregistration
from haptigraph.study.sharing.protocol_files import publishable_parts, write_parts
from haptigraph.study.sharing.recordings import copy_recording
from haptigraph.study.sharing.redaction import Redacted, redacted, unique_people
from haptigraph.study.sharing.registry import Bundle, register
from haptigraph.study.sharing.rekeying import new_names, without_contacts

__all__ = ["WrittenBundle", "write_bundle"]


class WrittenBundle(Struct, frozen=True):
    """What was written."""

    contents: Contents
    problems: list[str]
    """A sentence for each recording that could not be copied."""


def write_bundle(
    study: Study, output: Path, without: Sequence[str] = (), progress: Progress | None = None
) -> WrittenBundle:
    """Write a study into a new folder for a repository, and note in the study's folder whom it contains.

    Args:
        study: The study.
        output: The folder to create.
        without: Columns of `participants` to leave out, with their answers.
        progress: Called with the progress.

    Raises:
        BadInput: If the protocol was changed, there is nothing to report, or the folder exists or cannot
            be written.
    """
    study.check_frozen()
    about, tables = about_study(study.store, study.name), tidy_tables(study.store, study.name)
    people = {row["participant"]: row for row in tables["participants"][1]}
    names = new_names(people)
    questionnaires = [each for _, each in study.protocol.questionnaires]
    shareable = redacted(tables, questionnaires, names, without)
    parts, contacts = publishable_parts(about.parts)
    public = replace(
        about,
        parts=parts,
        title=without_contacts(about.title)[0],
        frozen_utc=about.frozen_utc[: len("2026-11")],
        edited_parts=(),
    )
    with new_folder(output) as folder:
        problems = _copy_recordings(shareable, study.protocol.folder, folder, names, people, progress)
        (folder / "tables").mkdir()
        write_tables(folder / "tables", shareable.tables, public)
        write_parts(folder / "protocol", parts)
        _write_report(study, folder, progress)
        contents = Contents(
            participants=len(shareable.present),
            recordings=len(list(folder.rglob("*.mcap"))),
            left_out=shareable.left_out,
            contacts=contacts,
            unique=unique_people(shareable.tables, questionnaires),
        )
        _write_texts(study, folder, public, contents)
        write_checksums(folder)
        made = {name: names[name] for name in shareable.present}
        sha256 = sha256_of(folder / CHECKSUMS)
        register(study.protocol.folder, Bundle(str(output), study.store.now_utc(), sha256, made))
    return WrittenBundle(contents, problems)


def _copy_recordings(
    shareable: Redacted,
    source: Path,
    folder: Path,
    names: dict[str, str],
    people: dict[str, dict[str, object]],
    progress: Progress | None,
) -> list[str]:
    """Copy the recordings that may be published, and name them in the tables."""
    problems = []
    published = {_key(row): row for row in shareable.tables["trials"][1]}
    for done, row in enumerate(shareable.recordings):
        if progress is not None:
            progress("copying recordings", done, len(shareable.recordings))
        if problem := recording_problem(row, source):
            problems.append(problem)
            continue
        name = names[row["participant"]]
        path = f"recordings/{name}/{Path(row['recording']).name}"
        if not copy_recording(source / row["recording"], folder / path, name, people[row["participant"]]):
            problems.append(f"{row['recording']} lacks images; it is not included")
            continue
        trial = published[_key({**row, "participant": name})]
        trial |= {"recording": path, "recording_sha256": sha256_of(folder / path)}
    return problems


def _key(row: dict[str, object]) -> tuple[object, ...]:
    return tuple(row[name] for name in ("participant", "phase", "position", "block", "trial", "attempt"))


def _write_report(study: Study, folder: Path, progress: Progress | None) -> None:
    try:
        write_report(
            folder / "tables",
            folder / "report",
            recordings=folder,
            progress=progress,
            has_participants=False,
        )
    except BadInput as error:
        problem = f"cannot be reported, and so not bundled: {error.problem}"
        raise BadInput(problem, f"study {study.name}") from None


def _write_texts(study: Study, folder: Path, about: About, contents: Contents) -> None:
    """Write what describes the bundle, and what reproduces its report."""
    shutil.copyfile(reproduce.__file__, folder / "reproduce.py")
    texts = {
        "preregistration.md": without_contacts(preregistration(study.protocol, about))[0],
        "environment.txt": environment(),
        "requirements.txt": requirements(),
        "README.md": readme(about, contents),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, "utf-8")
