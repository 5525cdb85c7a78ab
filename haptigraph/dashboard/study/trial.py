"""Run the trials that pages ask for: loop, recording, outcome. In the main thread, where signals arrive.

Knows no page; the desk tells it what is asked for, and is told how it went.
"""

import time
from collections.abc import Callable
from contextlib import closing, suppress

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.assemble import build, load_procedure
from haptigraph.config import Config
from haptigraph.dashboard.study.service import StudyService
from haptigraph.dashboard.study.site import StudySite
from haptigraph.errors import BadInput, HaptigraphError, StoreFailed
from haptigraph.messages import Step
from haptigraph.pipeline import Loop
from haptigraph.study.plan import Stage
from haptigraph.study.runner import Outcome, Session

__all__ = ["TrialEnd", "run_trials"]

AGAIN_S = (0, 1, 2, 4, 8)  # a database may be starting again
FELT_NS = 1_500_000_000  # so long a trial goes on after the hit, that the hand may feel it


class TrialEnd:
    """When a trial ends, and how: fed its steps in order.

    A trial is a hit when the run of its recording is (`RunMeasures`). It ends 1.5 s later, at its timeout, or
    when somebody ends it; free training does not end by a hit.

    Args:
        stage: The trial.
        measures: Empty measures of a run under its procedure.
    """

    def __init__(self, stage: Stage, measures: RunMeasures) -> None:
        self._stage, self._measures = stage, measures

    @property
    def outcome(self) -> Outcome:
        """How it stands: whether the target has been hit."""
        return "timeout" if self._measures.ended_ns is None else "hit"

    def add(self, step: Step) -> bool:
        """Take the next step; tell whether it was the last."""
        measures = self._measures
        measures.add(step)
        if measures.ended_ns is not None and not self._stage.free:
            return step.stamp_ns - measures.ended_ns >= FELT_NS
        return step.stamp_ns - measures.first_ns >= self._stage.timeout_s * 1e9


def run_trials(service: StudyService, site: StudySite, base: Config, tell: Callable[[str], None]) -> None:
    """Run one trial after the other, until Ctrl-C.

    Args:
        service: Says which.
        site: Shows them.
        base: The station's configuration: source, registration, device.
        tell: Told in a line how each one went.
    """
    while True:
        session, stage = service.wait()
        problem = ""
        try:
            _run(service, site, base, session, stage, tell)
        except (HaptigraphError, OSError) as error:  # before it began: that has cost no attempt
            problem = f"the trial did not begin: {error}"
        if problem:
            tell(f"haptigraph: {problem}")
            service.now("", problem)


def _run(
    service: StudyService,
    site: StudySite,
    base: Config,
    session: Session,
    stage: Stage,
    tell: Callable[[str], None],
) -> None:
    config = session.config(base)
    measures = RunMeasures.under(load_procedure(config.run.procedure))
    end = TrialEnd(stage, measures)
    stopped: KeyboardInterrupt | None = None
    with closing(build(config, sinks=[site.hub], listener=site.hub.felt)) as loop:
        shown = site.shown(config, loop, measures)
        attempt = session.begin_trial(stage.key).attempt
        shown()
        try:
            outcome, void = _played(loop, end, service)
        except KeyboardInterrupt as pressed:
            outcome, void, stopped = "aborted", "haptigraph was stopped", pressed
        except HaptigraphError as error:
            outcome, void = "aborted", str(error)
        service.now("ending")
    site.ended()
    problem = _kept(session, outcome, void)
    if outcome == "aborted" and service.ending is None:  # by no page
        problem = problem or f"the trial was aborted: {void}"
    tell(f"{session.participant}  {stage.key}, attempt {attempt}: {problem or outcome}")
    service.now("", problem)
    if stopped is not None:
        raise stopped


def _played(loop: Loop, end: TrialEnd, service: StudyService) -> tuple[Outcome, str]:
    """Play a trial to its end; return its outcome, and why it does not count if it does not."""
    with closing(loop.steps()) as steps:
        for step in steps:
            if not service.begun_ns:
                service.now("running", begun_ns=time.monotonic_ns())
            is_over = end.add(step)
            if service.ending is not None:
                how, reason = service.ending
                return ("aborted", reason) if how == "aborted" else (end.outcome, "")
            if is_over:
                return end.outcome, ""
    return ("hit", "") if end.outcome == "hit" else ("aborted", "the source has ended")


def _kept(session: Session, outcome: Outcome, void: str) -> str:
    """End a trial in the store, trying again if it fails; say what went wrong."""
    for wait_s in AGAIN_S:
        try:
            session.end_trial(outcome, void=void)
        except StoreFailed:
            time.sleep(wait_s)
        except (
            BadInput,
            OSError,
        ) as error:  # another station has the participant, or the recording is not whole
            with suppress(BadInput):
                session.end_trial("aborted", void=str(error))
                return f"the trial does not count: {error}"
            return f"the trial is not kept: {error}"
        else:
            return ""
    return "the trial is not kept: the store fails; when it is back, Resume lets the trial be done again"
