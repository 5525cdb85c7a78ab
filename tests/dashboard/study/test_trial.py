"""When a trial ends, and how; what the desk does when the store or the source fails."""

from contextlib import closing
from pathlib import Path

import pytest
from msgspec.structs import replace
from studying import PROTOCOL, study_at

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.assemble import build
from haptigraph.config import load_config
from haptigraph.dashboard.server.server import listen
from haptigraph.dashboard.study.service import StudyService
from haptigraph.dashboard.study.site import StudySite
from haptigraph.dashboard.study.trial import FELT_NS, TrialEnd, run_trials
from haptigraph.dashboard.study.views import experimenter_view, participant_view
from haptigraph.errors import BadInput, StoreFailed
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
    """How a trial of these steps ends, and after how many of them; all: it does not end before they do."""
    end = TrialEnd(Stage("trial", **stage), RunMeasures.under(procedure))
    count = next((number for number, step in enumerate(steps, 1) if end.add(step)), len(steps))
    return end.outcome, count


def test_a_trial_ends_when_its_hit_has_been_felt(steps, procedure):
    hit = next(number for number, step in enumerate(steps) if step.conclusion.state == "target_hit")
    last = next(n for n, step in enumerate(steps, 1) if step.stamp_ns - steps[hit].stamp_ns >= FELT_NS)
    assert ended(steps, procedure, timeout_s=60.0) == ("hit", last)
    assert ended(steps, procedure, timeout_s=(steps[hit].stamp_ns - steps[0].stamp_ns) / 1e9 + 0.1) == (
        "hit",
        last,
    )


def test_a_trial_ends_at_its_timeout_to_the_image(steps, procedure):
    outcome, count = ended(steps, procedure, timeout_s=2.0)
    assert outcome == "timeout"
    assert [(step.stamp_ns - steps[0].stamp_ns) / 1e9 >= 2.0 for step in steps[count - 2 : count]] == [
        False,
        True,
    ]


def test_free_training_goes_on_after_a_hit_and_says_that_there_was_one(steps, procedure):
    assert ended(steps, procedure, timeout_s=60.0, free=True) == ("hit", len(steps))
    assert ended(steps[:30], procedure, timeout_s=60.0, free=True)[0] == "timeout"


@pytest.fixture
def service(tmp_path):
    (tmp_path / "study.toml").write_text(PROTOCOL)
    with closing(Store(tmp_path / "study.db")) as store:
        service = StudyService(tmp_path, study_at(tmp_path, store), "lab 1")
        service.open(service.enrol(None), take_over=False)
        yield service


def go_to_the_training(service):
    session = service.session
    while not session.next().stage.is_trial:
        stage = session.next().stage
        if stage.kind == "questionnaire":
            for item in service.study.protocol.questionnaire(stage.questionnaire).items:
                session.answer(stage.key, item.key, item.choices[0] if item.choices else "30")
        session.done(stage.key)
    return session.next().stage


class Over(Exception):
    """There is no other trial to wait for."""


def run_one(service, monkeypatch, base, meanwhile=lambda: None):
    """Run the trial that is asked for, here; do something while it runs. What was told of it."""
    told = []
    overrides = iter([service.wait()])

    def wait():
        for wish in overrides:
            return wish
        raise Over

    monkeypatch.setattr(service, "wait", wait)
    monkeypatch.setattr(service, "on_change", lambda: meanwhile() if service.doing == "running" else None)
    with closing(listen("127.0.0.1", 0)) as listener, pytest.raises(Over):
        run_trials(service, StudySite(service, base, listener, host="127.0.0.1", token=""), base, told.append)
    return told


def base(quick_uri, *more):
    return load_config(None, (f"source.uri={quick_uri}", "run.realtime=false", *more))


def test_what_does_not_open_costs_no_attempt_and_is_told(service, monkeypatch):
    stage = go_to_the_training(service)
    service.begin("P01", stage.key)
    (told,) = run_one(service, monkeypatch, base("phantom:nowhere"))
    assert "the trial did not begin: unknown scenario 'nowhere'" in told
    assert (service.doing, service.session.next().attempt) == ("", 1)
    assert "unknown scenario" in experimenter_view(service)["problem"]
    assert participant_view(service)["trouble"] is True  # but not why
    assert "nowhere" not in str(participant_view(service))


def test_a_source_that_ends_before_the_trial_does_makes_an_attempt_that_does_not_count(
    service, monkeypatch, quick_uri
):
    stage = go_to_the_training(service)
    service.begin("P01", stage.key)
    (told,) = run_one(service, monkeypatch, base(quick_uri))
    assert told == "P01  training/0/0/1, attempt 1: the trial was aborted: the source has ended"
    coming = service.session.next()
    assert (coming.stage.key, coming.attempt, coming.running) == (stage.key, 2, False)


def test_who_is_taken_over_in_the_middle_of_a_trial_keeps_nothing_of_it(service, monkeypatch, quick_uri):
    stage = go_to_the_training(service)
    service.begin("P01", stage.key)
    (told,) = run_one(
        service,
        monkeypatch,
        base(quick_uri),
        lambda: open_session(service.study, "P01", "lab 2", take_over=True),
    )
    assert "the trial is not kept: participant P01 is at lab 2 now" in told
    rows = service.study.store.rows(TRIALS.select())
    assert [(row["attempt"], row["outcome"], row["void"]) for row in rows] == [(1, "aborted", "interrupted")]
    assert service.here() is None and service.doing == ""


@pytest.mark.parametrize(("failures", "told"), [(3, "hit"), (99, "the trial is not kept: the store fails")])
def test_a_store_that_fails_is_asked_again_for_a_while(service, monkeypatch, quick_uri, failures, told):
    stage = go_to_the_training(service)
    waited = []
    monkeypatch.setattr("haptigraph.dashboard.study.trial.time.sleep", waited.append)
    monkeypatch.setattr("haptigraph.dashboard.study.trial._played", lambda *_: ("hit", ""))
    end_trial = service.session.end_trial

    def fails(outcome, void):
        if len(waited) < failures:
            raise StoreFailed("the store does not take it (server closed the connection)", "store")
        end_trial(outcome, void=void)

    monkeypatch.setattr(service.session, "end_trial", fails)
    service.begin("P01", stage.key)
    (line,) = run_one(service, monkeypatch, base(quick_uri))
    assert told in line and service.doing == ""
    assert (service.session.next().running, waited) == (failures == 99, [0, 1, 2, 4, 8][:failures])


def test_a_refused_participant_does_not_cost_the_one_who_is_here(service):
    with pytest.raises(BadInput, match="has no participant 'P05'"):
        service.open("P05", take_over=False)
    assert service.here().participant == "P01"
    second = service.enrol(None)
    service.open(second, take_over=False)
    assert service.here().participant == second
    assert [each["station"] for each in experimenter_view(service)["participants"]] == ["", "lab 1"]


@pytest.mark.parametrize("blind", ["nobody", "participant", "everyone"])
def test_who_is_blinded_is_told_no_condition(service, blind):
    go_to_the_training(service)
    protocol = replace(service.study.protocol, study=replace(service.study.protocol.study, blind=blind))
    service.study = replace(service.study, protocol=protocol)
    person, lab = participant_view(service), experimenter_view(service)
    assert ("Detection" in str(person)) is (blind == "nobody")
    assert ("Detection" in str(lab)) is (blind != "everyone")
    assert lab["shows_all"] is (blind != "everyone")
    assert lab["here"]["is_felt"] is True  # so it is, and so it is said where nobody may know


def test_pages_say_when_a_study_is_simulated(tmp_path):
    (tmp_path / "study.toml").write_text(PROTOCOL)
    with closing(Store(tmp_path / "study.db")) as store:
        study = study_at(tmp_path, store)
        study = type(study)(study.protocol, store, simulated=True)
        service = StudyService(tmp_path, study, "lab 1")
        service.open(service.enrol(None), take_over=False)
        assert experimenter_view(service)["simulated"] is participant_view(service)["simulated"] is True
        with pytest.raises(BadInput, match="has simulated participants; people need a study of another name"):
            StudyService(tmp_path, study_at(tmp_path, store), "lab 1").enrol(None)
