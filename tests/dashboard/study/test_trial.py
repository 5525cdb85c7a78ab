"""When and how a trial ends; what the service does when the store or the source fails."""

from contextlib import closing
from pathlib import Path

import pytest
import stuck_device
from helpers import LOW
from msgspec.structs import replace
from studying import PROTOCOL, study_at

from haptigraph import assemble
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.assemble import build
from haptigraph.clock import VirtualClock
from haptigraph.config import HapticsConfig, load_config
from haptigraph.dashboard.server.server import listen
from haptigraph.dashboard.server.viewer import Viewer
from haptigraph.dashboard.study.service import StudyService
from haptigraph.dashboard.study.site import StudySite
from haptigraph.dashboard.study.snapshots import experimenter_snapshot, participant_snapshot
from haptigraph.dashboard.study.stimulus import Stimulus
from haptigraph.dashboard.study.touch_output import TouchOutput
from haptigraph.dashboard.study.trial import AFTER_HIT_NS, TrialEnd, run_trials
from haptigraph.errors import BadInput, NotSilent, StoreFailed
from haptigraph.study.plan import Stage
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store
from haptigraph.study.tables import TRIALS


@pytest.fixture(scope="module")
def steps(quick, tmp_path_factory):
    """A run that hits the target after six seconds, and stays there."""
    file = tmp_path_factory.mktemp("scenario") / "stays.toml"
    file.write_text(Path(quick).read_text().replace("duration_s = 0.7", "duration_s = 2.0"))
    given = (f"source.uri=phantom:{file}", "run.realtime=false", "source.target_mm=3.0")
    return list(build(load_config(None, given)).steps())


def ended(steps, procedure, **stage):
    """Return the outcome of a trial with these steps, and after how many it ends; all if it does not end."""
    end = TrialEnd(Stage("trial", **stage), RunMeasures.under(procedure))
    count = next((number for number, step in enumerate(steps, 1) if end.add(step)), len(steps))
    return end.outcome, count


def test_a_trial_ends_some_time_after_the_hit(steps, procedure):
    hit = next(number for number, step in enumerate(steps) if step.conclusion.state == "target_hit")
    last = next(n for n, step in enumerate(steps, 1) if step.stamp_ns - steps[hit].stamp_ns >= AFTER_HIT_NS)
    assert ended(steps, procedure, timeout_s=60.0) == ("hit", last)
    assert ended(steps, procedure, timeout_s=(steps[hit].stamp_ns - steps[0].stamp_ns) / 1e9 + 0.1) == (
        "hit",
        last,
    )


def test_a_trial_ends_at_the_first_image_after_its_timeout(steps, procedure):
    outcome, count = ended(steps, procedure, timeout_s=2.0)
    assert outcome == "timeout"
    assert [(step.stamp_ns - steps[0].stamp_ns) / 1e9 >= 2.0 for step in steps[count - 2 : count]] == [
        False,
        True,
    ]


def test_free_training_continues_after_a_hit_and_reports_it(steps, procedure):
    assert ended(steps, procedure, timeout_s=60.0, free=True) == ("hit", len(steps))
    assert ended(steps[:30], procedure, timeout_s=60.0, free=True)[0] == "timeout"


@pytest.fixture
def service(tmp_path):
    (tmp_path / "study.toml").write_text(f"{PROTOCOL}\n[quality]\nmin_images_per_s = 20\n")
    with closing(Store(tmp_path / "study.db")) as store:
        service = StudyService(tmp_path, study_at(tmp_path, store), "lab 1")
        service.touch = TouchOutput(HapticsConfig(), [screen()], lambda *_: None, lambda stamp_ns: None)
        service.open(service.enrol(None), take_over=False)
        yield service


def screen():
    """A participant's page on which the border shows the haptic feedback."""
    viewer = Viewer("participant's page 1")
    viewer.outputs = ("screen",)
    return viewer


def go_to_the_training(service):
    session = service.session
    while not session.next().stage.is_trial:
        stage = session.next().stage
        if stage.kind == "questionnaire":
            for item in service.study.protocol.questionnaire(stage.questionnaire).items:
                session.answer(stage.key, item.key, item.choices[0] if item.choices else "30")
        session.done(stage.key)
    session.answer_pulse("screen", is_felt=True)
    return session.next().stage


class Over(Exception):
    """No other trial is requested."""


def run_one(service, monkeypatch, base, meanwhile=lambda: None):
    """Run the requested trial in this thread, and call `meanwhile` while it runs; return the reported lines."""
    lines = []
    requested = iter([service.next_trial()])

    def next_trial():
        for trial in requested:
            return trial
        raise Over

    monkeypatch.setattr(service, "next_trial", next_trial)
    monkeypatch.setattr(
        service, "on_change", lambda: meanwhile() if service.trial_status == "running" else None
    )
    with closing(listen("127.0.0.1", 0)) as listener, pytest.raises(Over):
        run_trials(
            service, StudySite(service, base, listener, host="127.0.0.1", token=""), base, lines.append
        )
    return lines


def base(quick_uri, *more):
    return load_config(None, (f"source.uri={quick_uri}", "run.realtime=false", *more))


def test_a_source_that_does_not_open_uses_up_no_attempt(service, monkeypatch):
    stage = go_to_the_training(service)
    service.begin("P01", stage.key)
    (line,) = run_one(service, monkeypatch, base("phantom:nowhere"))
    assert "the trial did not begin: unknown scenario 'nowhere'" in line
    assert (service.trial_status, service.session.next().attempt) == ("", 1)
    assert "unknown scenario" in experimenter_snapshot(service)["problem"]
    assert participant_snapshot(service)["has_problem"] is True  # but not why
    assert "nowhere" not in str(participant_snapshot(service))


def test_a_device_that_is_gone_since_it_was_felt_uses_up_no_attempt(service, monkeypatch, quick_uri):
    def gone(name):
        raise BadInput("is not connected", name)

    monkeypatch.setattr(assemble, "open_device", gone)
    service.begin("P01", go_to_the_training(service).key)
    (line,) = run_one(
        service, monkeypatch, load_config(None, (f"source.uri={quick_uri}", "haptics.device=audio"))
    )
    assert line == "haptigraph: the trial did not begin: audio: is not connected"
    assert (service.trial_status, service.session.next().attempt) == ("", 1)


def test_a_source_that_ends_early_voids_the_attempt(service, monkeypatch, quick_uri):
    stage = go_to_the_training(service)
    service.begin("P01", stage.key)
    (line,) = run_one(service, monkeypatch, base(quick_uri))
    assert line == "P01  training/0/0/1, attempt 1: the trial was aborted: the source has ended"
    coming = service.session.next()
    assert (coming.stage.key, coming.attempt, coming.running) == (stage.key, 2, False)


def test_a_stimulus_is_played_by_the_same_thread_and_keeps_trials_away(service, monkeypatch, quick_uri):
    monkeypatch.setattr("haptigraph.dashboard.study.trial.MonotonicClock", VirtualClock)
    stage = go_to_the_training(service)
    service.request_stimulus("P01", Stimulus("test pulse", LOW))
    assert (service.trial_status, service.played) == ("stimulus", "")
    with pytest.raises(BadInput, match="a vibration is played at this station; wait until it ends"):
        service.begin("P01", stage.key)
    with pytest.raises(BadInput, match="participant 'P02' is not at this station"):
        service.request_stimulus("P02", Stimulus("test pulse", LOW))
    assert run_one(service, monkeypatch, base(quick_uri)) == []
    assert (service.trial_status, service.played) == ("", "test pulse")


def test_a_stimulus_that_the_device_refuses_is_a_problem_on_the_page(service, monkeypatch, quick_uri):
    service.request_stimulus("P01", Stimulus("test pulse", LOW))
    (line,) = run_one(service, monkeypatch, base(quick_uri, "haptics.device=glove"))
    assert line.startswith("haptigraph: the vibration was not played: unknown device 'glove'")
    assert (service.trial_status, service.played) == ("", "")
    assert participant_snapshot(service)["has_problem"] is True


def test_poor_data_of_a_trial_are_a_remark_for_the_experimenter_alone(service, monkeypatch, quick_uri):
    monkeypatch.setattr("haptigraph.dashboard.study.trial._play", play_to_its_end)
    stage = go_to_the_training(service)
    service.begin("P01", stage.key)
    (line,) = run_one(service, monkeypatch, base(quick_uri))
    remark = "data quality of training/0/0/1: 14.85 images/s (at least 20)"
    assert line == f"P01  training/0/0/1, attempt 1: timeout; {remark}"
    shown = experimenter_snapshot(service)
    assert (shown["remark"], shown["problem"]) == (remark, "")
    seen_by_participant = participant_snapshot(service)
    assert not seen_by_participant["has_problem"] and "quality" not in str(seen_by_participant)
    service.set_trial_status("preparing")
    assert experimenter_snapshot(service)["remark"] == ""


def play_to_its_end(loop, end, service):
    for step in loop.steps():
        end.add(step)
    return end.outcome, ""


@pytest.fixture
def stuck(monkeypatch):
    monkeypatch.setitem(assemble.DEVICES, "stuck", stuck_device.PATH)


def test_a_device_that_may_still_vibrate_is_a_problem_on_the_page(service, monkeypatch, quick_uri, stuck):
    service.begin("P01", go_to_the_training(service).key)
    lines = run_one(service, monkeypatch, base(quick_uri, "haptics.device=stuck"))
    assert lines[-1] == stuck_device.NOT_SILENT
    assert "it may still vibrate" in experimenter_snapshot(service)["problem"]


def test_ctrl_c_in_a_trial_whose_device_may_still_vibrate_is_no_clean_end(
    service, monkeypatch, quick_uri, stuck
):
    def interrupted(loop, *_):
        for _ in loop.steps():
            pass
        raise KeyboardInterrupt

    monkeypatch.setattr("haptigraph.dashboard.study.trial._play", interrupted)
    service.begin("P01", go_to_the_training(service).key)
    with pytest.raises(NotSilent, match="stuck does not confirm silence"):
        run_one(service, monkeypatch, base(quick_uri, "haptics.device=stuck"))


def test_a_take_over_during_a_trial_voids_the_attempt(service, monkeypatch, quick_uri):
    stage = go_to_the_training(service)
    service.begin("P01", stage.key)
    (line,) = run_one(
        service,
        monkeypatch,
        base(quick_uri),
        lambda: open_session(service.study, "P01", "lab 2", take_over=True),
    )
    assert "the trial was not saved: participant P01 is at lab 2 now" in line
    rows = service.study.store.rows(TRIALS.select())
    assert [(row["attempt"], row["outcome"], row["void"]) for row in rows] == [(1, "aborted", "interrupted")]
    assert service.current_session() is None and service.trial_status == ""


@pytest.mark.parametrize(
    ("failures", "result"), [(3, "hit"), (99, "the trial was not saved: the store fails")]
)
def test_a_failing_store_is_retried_for_a_while(service, monkeypatch, quick_uri, failures, result):
    stage = go_to_the_training(service)
    waited = []
    monkeypatch.setattr("haptigraph.dashboard.study.trial.time.sleep", waited.append)
    monkeypatch.setattr("haptigraph.dashboard.study.trial._play", lambda *_: ("hit", ""))
    end_trial = service.session.end_trial

    def fails(outcome, void):
        if len(waited) < failures:
            raise StoreFailed("the store does not take it (server closed the connection)", "store")
        end_trial(outcome, void=void)

    monkeypatch.setattr(service.session, "end_trial", fails)
    service.begin("P01", stage.key)
    (line,) = run_one(service, monkeypatch, base(quick_uri))
    assert result in line and service.trial_status == ""
    assert (service.session.next().running, waited) == (failures == 99, [0, 1, 2, 4, 8][:failures])


def test_a_refused_participant_leaves_the_current_session_open(service):
    with pytest.raises(BadInput, match="has no participant 'P05'"):
        service.open("P05", take_over=False)
    assert service.current_session().participant == "P01"
    with pytest.raises(BadInput, match="P01 has a place in the study, but has not consented yet; undo the"):
        service.enrol(None)
    second = service.enrol(None, is_confirmed=True)
    service.open(second, take_over=False)
    assert service.current_session().participant == second
    assert [each["station"] for each in experimenter_snapshot(service)["participants"]] == ["", "lab 1"]


def test_an_enrolment_is_undone_at_its_station_until_the_consent(service):
    with pytest.raises(BadInput, match="participant 'P02' is not at this station; P01 is"):
        service.undo_enrolment("P02")
    service.undo_enrolment("P01")
    assert experimenter_snapshot(service)["current"] is None
    assert service.study.check_frozen() is None  # nobody is enrolled
    service.open(service.enrol(None), take_over=False)
    assert experimenter_snapshot(service)["current"]["may_undo_enrolment"] is True
    for _ in range(2):
        service.session.done(service.session.next().stage.key)
    assert experimenter_snapshot(service)["current"]["may_undo_enrolment"] is False
    assert service.enrol(None) == "P02"


@pytest.mark.parametrize("blind", ["nobody", "participant", "everyone"])
def test_blinded_snapshots_contain_no_condition(service, blind):
    go_to_the_training(service)
    protocol = replace(service.study.protocol, study=replace(service.study.protocol.study, blind=blind))
    service.study = replace(service.study, protocol=protocol)
    person, lab = participant_snapshot(service), experimenter_snapshot(service)
    assert ("Detection" in str(person)) is (blind == "nobody")
    assert ("Detection" in str(lab)) is (blind != "everyone")
    assert lab["shows_conditions"] is (blind != "everyone")
    assert lab["current"]["has_haptics"] is True  # also where blinding hides it


def test_snapshots_mark_a_simulated_study(tmp_path):
    (tmp_path / "study.toml").write_text(PROTOCOL)
    with closing(Store(tmp_path / "study.db")) as store:
        study = study_at(tmp_path, store)
        study = type(study)(study.protocol, store, simulated=True)
        service = StudyService(tmp_path, study, "lab 1")
        service.open(service.enrol(None), take_over=False)
        assert (
            experimenter_snapshot(service)["simulated"] is participant_snapshot(service)["simulated"] is True
        )
        with pytest.raises(BadInput, match="has simulated participants; people need a study of another name"):
            StudyService(tmp_path, study_at(tmp_path, store), "lab 1").enrol(None)
