"""Run the trials and stimuli that pages request. In the main thread, which receives signals."""

import time
from collections.abc import Callable
from contextlib import closing, suppress

from msgspec.structs import replace

from haptigraph.analysis.metrics.data_quality import DataQuality
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.assemble import build, load_procedure
from haptigraph.clock import MonotonicClock
from haptigraph.config import Config
from haptigraph.dashboard.study.service import StudyService
from haptigraph.dashboard.study.site import StudySite
from haptigraph.dashboard.study.stimulus import Stimulus, play_stimulus
from haptigraph.errors import BadInput, HaptigraphError, NotSilent, StoreFailed
from haptigraph.messages import Step
from haptigraph.pipeline import Loop
from haptigraph.study.frozen.quality import quality_problems
from haptigraph.study.plan import Stage
from haptigraph.study.runner import Outcome, Session

__all__ = ["TrialEnd", "run_trials"]

RETRY_S = (0, 1, 2, 4, 8)  # a database may be restarting
AFTER_HIT_NS = 1_500_000_000  # a trial goes on for so long after the hit, until its pattern has been played


class TrialEnd:
    """Decide when a trial ends, and with which outcome; feed it the steps in order.

    A trial is a hit when the run of its recording is (`RunMeasures`). It ends 1.5 s later, at its timeout, or
    when a person ends it; a hit does not end free training.

    Args:
        stage: The trial.
        measures: Empty measures of a run under its procedure.
    """

    def __init__(self, stage: Stage, measures: RunMeasures) -> None:
        self._stage, self._measures = stage, measures
        self.quality = DataQuality(measures)

    @property
    def outcome(self) -> Outcome:
        """The outcome so far: whether the target has been hit."""
        return "timeout" if self._measures.ended_ns is None else "hit"

    def add(self, step: Step) -> bool:
        """Add the next step; return whether it was the last."""
        measures = self._measures
        measures.add(step)
        self.quality.add(step)
        if measures.ended_ns is not None and not self._stage.free:
            return step.stamp_ns - measures.ended_ns >= AFTER_HIT_NS
        return step.stamp_ns - measures.first_ns >= self._stage.timeout_s * 1e9


def run_trials(service: StudyService, site: StudySite, base: Config, report: Callable[[str], None]) -> None:
    """Run one trial after the other, until Ctrl-C (KeyboardInterrupt).

    Args:
        service: Provides the requested trials.
        site: Shows them.
        base: The station's configuration: source, registration, device.
        report: Called with a line about every trial.

    Raises:
        NotSilent: If Ctrl-C ended a trial whose actuator may still vibrate.
    """
    while True:
        request = service.next_trial()
        problem = ""
        try:
            if isinstance(request, Stimulus):
                _stimulate(service, site, base, request)
            else:
                _run(service, site, base, *request, report)
        except NotSilent:
            raise
        except (HaptigraphError, OSError) as error:  # raised before the trial began: no attempt is used up
            what = "vibration was not played" if isinstance(request, Stimulus) else "trial did not begin"
            problem = f"the {what}: {error}"
        if problem:
            report(f"haptigraph: {problem}")
            service.set_trial_status("", problem)


def _stimulate(service: StudyService, site: StudySite, base: Config, stimulus: Stimulus) -> None:
    play_stimulus(stimulus, base.haptics, MonotonicClock(), site.hub.record_level, site.hub.keep_alive)
    service.played = stimulus.name
    service.set_trial_status("")


def _run(
    service: StudyService,
    site: StudySite,
    base: Config,
    session: Session,
    stage: Stage,
    report: Callable[[str], None],
) -> None:
    base = replace(base, trial=replace(base.trial, touch_output=service.touch.name))
    config = session.config(base)
    measures = RunMeasures.under(load_procedure(config.run.procedure))
    end = TrialEnd(stage, measures)
    stopped: KeyboardInterrupt | None = None
    with closing(build(config, sinks=[site.hub], listener=site.hub.record_level)) as loop:
        show = site.prepare(config, loop, measures)
        attempt = session.begin_trial(stage.key).attempt
        show()
        try:
            outcome, void = _play(loop, end, service)
        except KeyboardInterrupt as pressed:
            outcome, void, stopped = "aborted", "haptigraph was stopped", pressed
        except HaptigraphError as error:
            outcome, void = "aborted", str(error)
        site.end()  # before the recording is closed, which takes a while
        service.set_trial_status("ending")
    problem = _save(session, outcome, void)
    if outcome == "aborted" and service.ending is None:  # not by a page
        problem = problem or f"the trial was aborted: {void}"
    poor = quality_problems(end.quality.measures(), session.study.protocol.quality) if not problem else ()
    remark = f"data quality of {stage.key}: {', '.join(poor)}" if poor else ""
    is_ready = service.ending is not None and service.ending[0] == "ready"
    ended = "; ".join(filter(None, (problem or ("ended by “I am ready”" if is_ready else outcome), remark)))
    report(f"{session.participant}  {stage.key}, attempt {attempt}: {ended}")
    doubt = None if loop.report.is_silent else NotSilent(config.haptics.outputs)
    if doubt is not None:
        report(f"haptigraph: {doubt}")
        problem = "; ".join(filter(None, (problem, str(doubt))))
    service.set_trial_status("", problem, remark=remark)
    if stopped is not None:
        raise doubt or stopped


def _play(loop: Loop, end: TrialEnd, service: StudyService) -> tuple[Outcome, str]:
    """Play a trial to its end; return its outcome, and why it does not count, if it does not."""
    with closing(loop.steps()) as steps:
        for step in steps:
            if not service.started_ns:
                service.set_trial_status("running", started_ns=time.monotonic_ns())
            is_over = end.add(step)
            if service.ending is not None:
                how, reason = service.ending
                return ("aborted", reason) if how == "aborted" else (end.outcome, "")
            if is_over:
                return end.outcome, ""
    return ("hit", "") if end.outcome == "hit" else ("aborted", "the source has ended")


def _save(session: Session, outcome: Outcome, void: str) -> str:
    """End a trial in the store, with retries; return what went wrong, if anything."""
    for wait_s in RETRY_S:
        try:
            session.end_trial(outcome, void=void)
        except StoreFailed:
            time.sleep(wait_s)
        except (BadInput, OSError) as error:  # taken over by another station, or an incomplete recording
            with suppress(BadInput):
                session.end_trial("aborted", void=str(error))
                return f"the trial does not count: {error}"
            return f"the trial was not saved: {error}"
        else:
            return ""
    return "the trial was not saved: the store fails; when it works again, Resume repeats the trial"
