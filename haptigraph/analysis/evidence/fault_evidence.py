"""Evidence from a campaign of faults against the real program: `make faults`."""

from collections.abc import Iterator
from pathlib import Path

from haptigraph.analysis.evaluation.origin import Origin
from haptigraph.analysis.evidence.campaign import Session, Trial, read_campaign
from haptigraph.analysis.evidence.case import MIN_TRIALS, Claim, Evidence, Status
from haptigraph.analysis.evidence.hazards import FAULTS
from haptigraph.checksum import sha256_of

__all__ = ["fault_claims"]

CONFIDENCE = 0.95
COMMAND = "make faults"
BAR = f"no promise broken in at least {MIN_TRIALS} trials"


def fault_claims(path: str | Path | None, origin: Origin) -> Iterator[tuple[str, Claim]]:
    """Yield the claim about each kind of faults, with its hazard and what the campaign found.

    The promises that it judges are those of the program beneath the rules, so its results count for every
    procedure.

    Args:
        path: The results; None if there are none.
        origin: The software that they must be about.

    Raises:
        BadInput: If the file is not a result of the campaign.
    """
    trials = read_campaign(path, FAULTS) if path is not None else []
    for kind, (hazard, statement) in FAULTS.items():
        ran = [(session, trial) for session, trial in trials if trial.kind == kind and not trial.skipped]
        yield hazard, Claim(statement, (_evidence(path, kind, ran, origin),))


def _evidence(
    path: str | Path | None, kind: str, ran: list[tuple[Session | None, Trial]], origin: Origin
) -> Evidence:
    if path is None:
        problem = f"no results of faults of kind {kind!r}; give those of the campaign with --faults"
        return Evidence("faults", "missing", problem, BAR, COMMAND)
    sha256 = sha256_of(path)
    own = [
        (session, trial)
        for session, trial in ran
        if session is not None and session.origin.software_sha256 == origin.software_sha256
    ]
    status, figure = _judged(kind, [trial for _, trial in own or ran])
    if not own and ran:
        session = ran[-1][0]
        status = "origin not stated" if session is None else "stale"
        about = "software that the file does not state" if session is None else "other software"
        figure = f"about {about}, so it does not count: {figure}"
    last = (own or ran)[-1][0] if ran else None
    made = last.origin if last is not None else None
    return Evidence(
        *("faults", status, figure, BAR, COMMAND, str(path), sha256),
        *((made.version, made.commit, made.made_utc) if made else ()),
    )


def _judged(kind: str, trials: list[Trial]) -> tuple[Status, str]:
    broken = [trial for trial in trials if trial.failure]
    figure = f"faults of kind {kind!r}: {len(broken)} of {len(trials)} trials broke a promise"
    silences = [trial.silence_ms for trial in trials if trial.silence_ms is not None]
    if silences:
        figure += f"; silent after {max(silences):.0f} ms at most"
    if broken:
        return "fails", f"{figure}; the first: {broken[0].failure}"
    if len(trials) < MIN_TRIALS:
        return ("incomplete" if trials else "missing"), figure
    share = 1 - (1 - CONFIDENCE) ** (1 / len(trials))
    return "holds", f"{figure}; at {CONFIDENCE:.0%} confidence fewer than {share:.1%} do"
