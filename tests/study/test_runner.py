import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import pytest
from sqlalchemy import select
from walking import do_next, fill, go_to

from haptigraph.config import Config
from haptigraph.errors import BadInput
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study, study_in
from haptigraph.study.runner import open_session
from haptigraph.study.status import events_of, participant_statuses
from haptigraph.study.store import Store
from haptigraph.study.tables import ANSWERS, TRIALS

STAGES = [
    "briefing",
    "consent",
    "training/0/0/1",
    "trial/1/1/1",
    "trial/1/1/2",
    "questionnaire/sus/1",
    "break/2",
    "trial/2/1/1",
    "trial/2/1/2",
    "questionnaire/sus/2",
    "thanks",
]


@pytest.fixture
def session(study):
    return open_session(study, study.enrol(), "one")


def test_a_participant_completes_the_protocol_with_a_new_session_for_every_stage(folder, protocol, clock):
    keys = []
    with closing(Store(folder / "study.db", clock)) as store:
        Study(protocol, store).enrol("P01")
    for _ in range(len(STAGES)):
        with closing(Store(folder / "study.db", clock)) as store:
            session = open_session(Study(load_protocol(folder), store), "P01", "one")
            keys.append(session.next().stage.key)
            do_next(session)
    with closing(Store(folder / "study.db", clock)) as store:
        session = open_session(Study(protocol, store), "P01", "one")
        assert keys == STAGES
        assert (session.next().stage, session.next().ended) == (None, "all is done")
        trials = store.rows(select(TRIALS))
        assert [trial["session"] for trial in trials] == [3, 4, 5, 8, 9]
        assert {trial["outcome"] for trial in trials} == {"hit"} and {trial["void"] for trial in trials} == {
            None
        }
        assert len(store.rows(select(ANSWERS))) == 20


def test_actions_on_other_stages_are_refused_so_that_a_double_click_does_nothing(session):
    session.done("briefing")
    with pytest.raises(BadInput, match="P01: briefing does not come next, but consent"):
        session.done("briefing")
    for act in (
        lambda: session.begin_trial("trial/1/1/1"),
        lambda: session.answer("questionnaire/sus/1", "1", "3"),
    ):
        with pytest.raises(BadInput, match="does not come next, but consent"):
            act()
    with pytest.raises(BadInput, match="no trial is running"):
        session.end_trial("hit")
    with pytest.raises(BadInput, match="the next stage is not a trial yet to begin"):
        session.config(Config())
    assert session.next().stage.key == "consent"


def test_a_trial_is_begun_once_and_not_completed_like_other_stages(session):
    stage = go_to(session, "training")
    session.begin_trial(stage.key)
    assert session.next().running
    with pytest.raises(BadInput, match="has already begun"):
        session.begin_trial(stage.key)
    with pytest.raises(BadInput, match="is a trial; begin and end it instead"):
        session.done(stage.key)
    with pytest.raises(BadInput, match="unknown measure 'speed'"):
        session.end_trial("hit", measures={"speed": 3.0})
    with pytest.raises(BadInput, match=r"measure contacts: expected a finite integer, found 1\.5"):
        session.end_trial("hit", measures={"contacts": 1.5})
    assert session.next().running
    session.end_trial("hit", measures={"contacts": 2, "completion_s": None, "time_unknown_s": 0})
    (row,) = session.study.store.rows(select(TRIALS))
    assert row["measures"] == '{"contacts": 2, "time_unknown_s": 0.0}'


def test_an_answer_is_stored_at_once_and_may_change_until_it_is_submitted(session):
    stage = go_to(session, "questionnaire")
    fill(session, stage, upto=4)
    session.answer(stage.key, "2", "1")
    assert dict(session.next().answers) == {"1": "4", "2": "1", "3": "4", "4": "4"}
    with pytest.raises(BadInput, match="no answer yet to 5, 6, 7, 8, 9, 10"):
        session.done(stage.key)
    with pytest.raises(BadInput, match=r"item '3': expected a whole number from 1 to 5, found '6'"):
        session.answer(stage.key, "3", "6")
    with pytest.raises(BadInput, match="unknown item '11'"):
        session.answer(stage.key, "11", "3")
    fill(session, stage)
    session.done(stage.key)
    with pytest.raises(BadInput, match="does not come next"):
        session.answer(stage.key, "1", "1")
    assert len(session.study.store.rows(select(ANSWERS))) == 10


def test_an_answer_may_be_deleted_until_the_questionnaire_is_submitted(session):
    stage = go_to(session, "questionnaire")
    fill(session, stage)
    session.clear_answer(stage.key, "3")
    assert "3" not in session.next().answers
    with pytest.raises(BadInput, match="no answer yet to 3"):
        session.done(stage.key)
    session.answer(stage.key, "3", "1")
    session.done(stage.key)
    with pytest.raises(BadInput, match="does not come next"):
        session.clear_answer(stage.key, "3")
    assert len(session.study.store.rows(select(ANSWERS))) == 10


def test_a_trial_interrupted_by_a_crash_does_not_count_and_is_repeated(session):
    stage = go_to(session, "trial")
    session.begin_trial(stage.key)
    again = open_session(session.study, "P01", "one")
    upcoming = again.next()
    assert (upcoming.stage.key, upcoming.attempt, upcoming.running) == (stage.key, 2, False)
    do_next(again)
    rows = again.study.store.rows(select(TRIALS).where(TRIALS.c.phase == "trial").order_by(TRIALS.c.attempt))
    assert [(row["attempt"], row["outcome"], row["void"]) for row in rows] == [
        (1, "aborted", "interrupted"),
        (2, "hit", None),
    ]
    assert rows[0]["recording"] != rows[1]["recording"]


def test_a_trial_is_skipped_after_the_maximum_number_of_attempts(session):
    stage = go_to(session, "trial")
    for attempt in (1, 2):
        assert session.next().attempt == attempt
        session.begin_trial(stage.key)
        session.end_trial("aborted", void="camera came loose")
    assert session.next().stage.key == "trial/1/1/2"


def test_the_experimenter_can_repeat_the_preceding_trial(session):
    go_to(session, "trial")
    with pytest.raises(BadInput, match="not repeated without a reason"):
        session.repeat_trial("trial/1/1/1", " ")
    do_next(session)
    session.repeat_trial("trial/1/1/1", "the phone rang")
    assert (session.next().stage.key, session.next().attempt) == ("trial/1/1/1", 2)
    with pytest.raises(BadInput, match="trial/1/1/1 does not lie right behind"):
        session.repeat_trial("trial/1/1/1", "a second click")
    do_next(session)
    session.repeat_trial("trial/1/1/1", "and again")
    do_next(session)
    rows = session.study.store.rows(
        select(TRIALS).where(TRIALS.c.phase == "trial").order_by(TRIALS.c.attempt)
    )
    assert [row["void"] for row in rows] == ["the phone rang", "and again", None]
    assert len({row["seed"] for row in rows}) == 3 and len({row["target"] for row in rows}) == 1
    stage = go_to(session, "questionnaire")
    fill(session, stage, upto=1)
    with pytest.raises(BadInput, match="trial/1/1/2 does not lie right behind"):
        session.repeat_trial("trial/1/1/2", "too late")


@pytest.mark.parametrize(
    ("rule", "outcome", "done", "ended"),
    [
        ("timeouts_in_a_row = 2", "timeout", 6, "stopped: 2 timeouts in a row"),
        ("failed_trials = 1", "aborted", 4, "stopped: failed trials: 1"),
        ("session_min = 30", "hit", 3, "stopped: 30 minutes have passed"),
    ],
)
def test_stopping_rules_end_the_session(folder, store, clock, rule, outcome, done, ended):
    file = folder / "study.toml"
    file.write_text(file.read_text().replace("timeout_s = 60", f"timeout_s = 60\n[stop]\n{rule}"))
    study = Study(load_protocol(folder), store)
    session = open_session(study, study.enrol(), "one")
    go_to(session, "trial")
    if "min" in rule:
        clock.at += timedelta(minutes=31)
    while session.next().stage is not None:
        do_next(session, outcome)
    assert (session.next().ended, session.next().done) == (ended, done)


def test_notes_are_stored_in_order_and_a_stop_is_final(session):
    session.note("sits well")
    session.note("asks for a break")
    session.stop("feels sick")
    assert session.next().ended == "stopped: feels sick"
    assert open_session(session.study, "P01", "one").next().ended == "stopped: feels sick"
    events = [(event.kind, event.text) for event in events_of(session.study, "P01")]
    assert events == [("note", "sits well"), ("note", "asks for a break"), ("stop", "feels sick")]


def test_a_participant_is_at_one_station_and_another_must_take_over(session):
    with pytest.raises(BadInput, match=r"P01 is at station one since .* take it over"):
        open_session(session.study, "P01", "two")
    session.begin_trial(go_to(session, "trial").key)
    other = open_session(session.study, "P01", "two", take_over=True)
    with pytest.raises(BadInput, match="P01 is at two now; open the session again"):
        session.end_trial("hit")
    assert other.next().attempt == 2
    other.close()
    assert open_session(session.study, "P01", "one").next().attempt == 2


def test_only_pseudonyms_are_allowed_and_each_once(study):
    assert [study.enrol(), study.enrol("P03"), study.enrol()] == ["P01", "P03", "P02"]
    with pytest.raises(BadInput, match=r"already has a participant P01$"):
        study.enrol("P01")
    with pytest.raises(BadInput, match="already has a participant P01, which P1 could be confused with"):
        study.enrol("P1")
    for name in ("Anna Meier", "anna@example.org", "p4", "P", ""):
        with pytest.raises(BadInput, match="go by a pseudonym"):
            study.enrol(name)
    study.enrol()
    with pytest.raises(BadInput, match="is full: all 4 participants are enrolled"):
        study.enrol()
    with pytest.raises(BadInput, match=r"has no participant 'P09'; it has P01, P02, P03, P04$"):
        open_session(study, "P09", "one")


def test_the_slot_of_a_withdrawn_participant_is_reused(study):
    for _ in range(4):
        study.enrol()
    study.withdraw("P02")
    assert study.enrol() == "P05"
    rows = {row["participant"]: row for row in study.participants()}
    assert rows["P05"]["slot"] == rows["P02"]["slot"] == 1
    assert rows["P05"]["conditions"] == rows["P02"]["conditions"]
    with pytest.raises(BadInput, match="has already left the study"):
        study.withdraw("P02")
    assert open_session(study, "P02", "one").next().ended == "the participant has left the study"


def test_a_frozen_protocol_must_not_change(folder, study, store):
    assert study.check_frozen() is None
    study.enrol()
    assert study.check_frozen()["frozen_utc"].startswith("2026-11-21T09:")
    file = folder / "study.toml"
    text = file.read_text()
    file.write_text(text.replace("along_mm = 3", "along_mm = 4"))
    changed = Study(load_protocol(folder), store)
    for act in (changed.check_frozen, changed.enrol, lambda: open_session(changed, "P01", "one")):
        with pytest.raises(
            BadInput, match=r"study small: frozen since .*2026-11-21 09:.* but study\.toml was changed"
        ):
            act()
    file.write_text(text)
    assert Study(load_protocol(folder), store).enrol() == "P02"


def test_people_and_simulated_participants_do_not_share_a_study(study):
    study.enrol()
    with pytest.raises(BadInput, match="has people; simulated participants need a study of another name"):
        Study(study.protocol, study.store, simulated=True).enrol()
    assert study_in(study.store, study.protocol).simulated is False


def test_a_trial_runs_under_its_condition(session, folder):
    base = Config()
    configs = {}
    while (stage := session.next().stage) is not None:
        if stage.kind == "trial":
            configs.setdefault(stage.condition, session.config(base))
        do_next(session)
    assert configs["seen"].haptics.max_amplitude == 0.0
    assert configs["felt"].haptics == base.haptics
    assert {config.source.target_mm for config in configs.values()} <= {-3.0, 3.0}
    assert configs["felt"].trial.participant == "P01"
    path = configs["felt"].recording.path
    assert path.startswith(str(folder / "recordings" / "P01")) and "felt" not in path.rpartition("/")[2]


def test_a_recording_without_a_trial_is_renamed(session):
    go_to(session, "trial")
    for _ in range(2):
        path = Path(session.config(Config()).recording.path)
        path.write_bytes(b"of a run that never began as a trial")
    assert sorted(each.name.split(".", 1)[1] for each in path.parent.iterdir()) == ["mcap", "unused1.mcap"]
    session.begin_trial("trial/1/1/1")
    with pytest.raises(BadInput, match="not a trial yet to begin"):
        session.config(Config())
    with pytest.raises(BadInput, match="is not closed; end the run"):
        session.end_trial("hit")
    session.end_trial("aborted", void="the recording broke")


def test_statuses_show_the_progress_of_all_participants(study, session):
    study.enrol()
    session.begin_trial(go_to(session, "trial").key)
    one, two = participant_statuses(study)
    assert (one.participant, one.station, one.next.stage.key, one.next.running) == (
        "P01",
        "one",
        "trial/1/1/1",
        True,
    )
    assert (two.participant, two.station, two.next.done, two.next.of) == ("P02", "", 0, len(STAGES))


ENROLLING = """
import sys
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store
sys.path.insert(0, sys.argv[3])
from walking import go_to

study = Study(load_protocol(sys.argv[1]), Store(sys.argv[2]))
for _ in range(2):
    session = open_session(study, study.enrol(), sys.argv[4])
    go_to(session, "break")
    print(session.participant)
"""


def test_two_stations_at_one_store_do_not_interfere(folder, protocol, where):
    """Both create the tables, freeze the protocol and enrol participants at the same time."""
    here = str(__file__).rpartition("/")[0]

    def station(name):
        command = [sys.executable, "-c", ENROLLING, str(folder), where, here, name]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()

    with ThreadPoolExecutor(2) as pool:
        found = [name for names in pool.map(station, ["one", "two"]) for name in names]
    assert sorted(found) == ["P01", "P02", "P03", "P04"]
    with closing(Store(where)) as store:
        study = Study(protocol, store)
        assert sorted(row["slot"] for row in study.participants()) == [0, 1, 2, 3]
        assert all(
            each.next.stage.key == "break/2" and each.void == 0 for each in participant_statuses(study)
        )
        assert len(store.rows(select(TRIALS))) == 4 * 3
        assert len(store.rows(select(ANSWERS))) == 4 * 10
