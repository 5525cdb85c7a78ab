"""Evidence from recordings: the temporal claims that they monitored, and what their registration assumes."""

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec import Struct

from haptigraph.analysis.evaluation.origin import Origin
from haptigraph.analysis.evidence.case import Claim, Evidence, Status
from haptigraph.analysis.evidence.hazards import hazard_of_temporal
from haptigraph.analysis.metrics.replay import recorded_config, recorded_registration
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.metrics.temporal import ClaimResult
from haptigraph.assemble import is_realtime
from haptigraph.checksum import sha256_of
from haptigraph.errors import BadInput
from haptigraph.inference.claims import Temporal
from haptigraph.inference.procedure import Procedure
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.assumed import assumed_text, needs_consent

__all__ = ["run_claims"]

COMMAND = "haptigraph run SOURCE --record run.mcap"
REGISTERED = "No position of the eye is assumed; each was found or stated"


class _Run(Struct, frozen=True):
    """What one recording has to say."""

    path: str
    sha256: str
    version: str
    started: str
    is_realtime: bool
    assumed: tuple[str, ...]
    claims: dict[str, ClaimResult]
    refusal: tuple[Status, str] | None
    """Why it does not count."""


def run_claims(
    paths: Sequence[str | Path], procedure: Procedure, origin: Origin, progress: Progress | None = None
) -> Iterator[tuple[str, Claim]]:
    """Yield every temporal claim, and one about the registration, with hazard and what the recordings show.

    Args:
        paths: The recordings.
        procedure: Whose claims they are.
        origin: The software and the procedure that the recordings must be about.
        progress: Called with the progress.

    Raises:
        BadInput: If a file is not a recording, or has no complete step.
    """
    runs = []
    for number, path in enumerate(paths):
        if progress is not None:
            progress("reading recordings", number, len(paths))
        runs.append(_read(path, procedure, origin))
    for claim in procedure.temporal:
        yield hazard_of_temporal(procedure, claim), _claim(claim, runs)
    bar = "the registration has no position in `assumed`"
    yield (
        "wrong_registration",
        Claim(REGISTERED, tuple(_registered(run, bar) for run in runs) or (_missing(bar),)),
    )


def _read(path: str | Path, procedure: Procedure, origin: Origin) -> _Run:
    reader, measures = RunReader(path), RunMeasures.under(procedure)
    for _, step in reader.records(images=()):
        measures.add(step)
    if not measures.steps:
        raise BadInput("has no complete step", path)
    info = reader.info
    refusal: tuple[Status, str] | None = None
    if info.procedure_sha256 != origin.procedure_sha256:
        refusal = "other procedure", f"about another procedure (sha256 {info.procedure_sha256[:12]})"
    elif info.version != origin.version:
        refusal = "stale", f"made by version {info.version}"
    elif not reader.is_whole:
        refusal = "incomplete", "the recording was interrupted; `haptigraph recover` completes it"
    return _Run(
        *(str(path), sha256_of(path), info.version, info.started_utc, is_realtime(recorded_config(reader))),
        *(recorded_registration(reader).assumed, {each.name: each for each in measures.claims}, refusal),
    )


def _claim(claim: Temporal, runs: Sequence[_Run]) -> Claim:
    bar = (
        f"within {claim.within_ms:g} ms, every time"
        if claim.within_ms is not None
        else f"at most {claim.most_changes} changes in {claim.in_ms:g} ms"
    )
    evidence = tuple(_evidence(run, claim, bar) for run in runs)
    return Claim(claim.name, evidence or (_missing(bar),))


def _evidence(run: _Run, claim: Temporal, bar: str) -> Evidence:
    result = run.claims[claim.name]
    status, figure = _judged(run, claim, result)
    return _of_run(run, status, figure, bar)


def _judged(run: _Run, claim: Temporal, result: ClaimResult) -> tuple[Status, str]:
    figure = f"cases: {result.cases}, violations: {result.broken}, at most {result.most:.3g} {result.unit}"
    if result.broken:
        return "fails", figure
    if claim.within_ms is not None and not result.cases:
        return "not exercised", "its premise never became true"
    if claim.within_ms is not None and not run.is_realtime:
        return "not exercised", "the run was not in real time, so it measures no delay"
    return "holds", figure


def _registered(run: _Run, bar: str) -> Evidence:
    if needs_consent(run.assumed):
        return _of_run(run, "fails", f"assumed: {assumed_text(run.assumed)}", bar)
    return _of_run(run, "holds", "no position is assumed", bar)


def _of_run(run: _Run, status: Status, figure: str, bar: str) -> Evidence:
    if run.refusal is not None:
        status, reason = run.refusal
        figure = f"{reason}, so it does not count: {figure}"
    command = shlex.join(["haptigraph", "replay", run.path])
    return Evidence(
        *("runs", status, figure, bar, command, run.path, run.sha256, run.version),
        *("not stated in recordings", run.started),
    )


def _missing(bar: str) -> Evidence:
    return Evidence("runs", "missing", "no recording; give some with --run", bar, COMMAND)
