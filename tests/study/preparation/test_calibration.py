"""The tasks of a calibration: their order, their end, what is stored, and what follows for the trials."""

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from protocols import CALIBRATED, SMALL
from sqlalchemy import select
from walking import HAPTICS, calibrate, do_next, go_to

from haptigraph.assemble import load_procedure
from haptigraph.config import Config, HapticsConfig
from haptigraph.errors import BadInput
from haptigraph.haptics.pattern import amplitude_range
from haptigraph.study.erasure import find_data
from haptigraph.study.preparation.calibration import Calibration, Response, next_stimulus, threshold_of
from haptigraph.study.preparation.strength import strength_of
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.runner import open_session
from haptigraph.study.tables import CALIBRATION, EVENTS

PATTERNS = load_procedure("subretinal_injection").patterns


def named(responses, **table):
    return next_stimulus("patterns", Calibration(**table), PATTERNS, responses, (1, 0))


def walk(answer, **table):
    """Respond to patterns until the task is complete; return the responses."""
    responses: list[Response] = []
    while (stimulus := named(responses, **table)) is not None:
        name = stimulus.pattern.name
        responses.append(Response(name, stimulus.pattern.amplitude, answer(stimulus)))
    return responses


@settings(max_examples=20)
@given(st.integers(1, 6), st.integers(0, 2**32 - 1), st.integers(0, 50))
def test_every_pattern_is_presented_equally_often_in_an_order_of_seed_and_slot(times, seed, slot):
    def order(key):
        responses = []
        while (
            stimulus := next_stimulus("patterns", Calibration(presentations=times), PATTERNS, responses, key)
        ) is not None:
            responses.append(Response(stimulus.pattern.name, stimulus.pattern.amplitude, "low"))
        return [each.pattern for each in responses]

    assert Counter(order((seed, slot))) == {"low": times, "pulse": times, "success": times}
    assert order((seed, slot)) == order((seed, slot))


def test_rounds_end_with_the_first_without_an_error_or_with_the_last_allowed():
    assert len(walk(lambda stimulus: stimulus.pattern.name, presentations=2, max_rounds=3)) == 6
    assert len(walk(lambda stimulus: "low", presentations=2, max_rounds=3)) == 18
    late = walk(
        lambda stimulus: stimulus.pattern.name if stimulus.number > 2 else "low",
        presentations=2,
        max_rounds=3,
    )
    assert len(late) == 12
    orders = [[each.pattern for each in late[start : start + 6]] for start in (0, 6)]
    assert orders[0] != orders[1]


def test_a_catch_trial_is_correct_if_nothing_was_felt():
    assert Response("", 0.0, "not felt").is_correct and not Response("", 0.0, "felt").is_correct
    assert Response("", 0.2, "felt").is_correct and not Response("", 0.2, "not felt").is_correct
    assert Response("low", 0.3, "low").is_correct and not Response("low", 0.3, "pulse").is_correct


@pytest.fixture
def folder(folder):
    (folder / "study.toml").write_text(CALIBRATED)
    return folder


@pytest.fixture
def session(study):
    session = open_session(study, study.enrol(), "lab 1")
    go_to(session, "calibration")
    return session


def settings_of(session):
    go_to(session, "trial")
    while session.study.protocol.condition(session.next().stage.condition).touch is False:
        do_next(session)
        go_to(session, "trial")
    return session.config(Config()).haptics


def test_a_measured_threshold_sets_the_weakest_pattern_of_the_trials(session):
    stage = session.next().stage
    assert stage.key == "calibration/threshold"
    calibrate(session, stage, threshold=0.1)
    rows = session.study.store.rows(select(CALIBRATION).order_by(CALIBRATION.c.number))
    assert [row["number"] for row in rows] == list(range(1, 21))
    assert sum(row["amplitude"] == 0 for row in rows) == 4
    assert {row["device"] for row in rows} == {"console"} and all(row["correct"] in (0, 1) for row in rows)
    responses = [Response("", row["amplitude"], row["response"]) for row in rows]
    threshold = threshold_of(responses)
    assert threshold.is_known and threshold.low <= 0.1 <= threshold.high
    weakest = settings_of(session).weakest_amplitude
    assert weakest == pytest.approx(3 * threshold.amplitude, abs=1e-4)
    session.close()
    assert find_data(session.study, "P01").rows["calibration"] == 20 + 6


def test_patterns_are_named_as_strong_as_in_the_trials(session):
    calibrate(session, session.next().stage)
    assert session.next().stage.key == "calibration/patterns"
    seen = {}
    while (stimulus := session.stimulus(HAPTICS)) is not None:
        seen[stimulus.pattern.name] = stimulus.pattern.amplitude
        session.respond("calibration/patterns", stimulus.number, stimulus.pattern.name, HAPTICS, "screen")
    assert session.next().stage.kind == "training"
    assert seen["pulse"] == 1.0 and seen["low"] == settings_of(session).weakest_amplitude
    rows = session.study.store.rows(select(CALIBRATION).where(CALIBRATION.c.task == "patterns"))
    assert {(row["round"], row["correct"], row["page_output"]) for row in rows} == {(1, 1, "screen")}


def test_a_crash_or_another_device_loses_no_response(session):
    stage = session.next().stage
    calibrate(session, stage, upto=7)
    again = open_session(session.study, "P01", "lab 1")
    assert again.stimulus(HAPTICS).number == 8
    other = replace(HAPTICS, device="gamepad:0")
    assert again.stimulus(other).number == 1
    assert again.stimulus(HAPTICS) == session.stimulus(HAPTICS)
    with pytest.raises(BadInput, match="stimulus 7 does not come next, but stimulus 8"):
        again.respond(stage.key, 7, "felt", HAPTICS)
    with pytest.raises(BadInput, match="expected felt, not felt; found 'maybe'"):
        again.respond(stage.key, 8, "maybe", HAPTICS)
    with pytest.raises(BadInput, match="ends with the response to its last stimulus"):
        again.done(stage.key)


def test_a_skipped_calibration_leaves_a_note_and_the_amplitudes_of_the_procedure(session):
    with pytest.raises(BadInput, match="not skipped without a reason"):
        session.skip_calibration("calibration/threshold", " ")
    session.skip_calibration("calibration/threshold", "the motor is broken")
    session.skip_calibration("calibration/patterns", "the motor is broken")
    (note,) = session.study.store.rows(select(EVENTS.c.text).where(EVENTS.c.number == 1))
    assert note["text"] == "calibration/threshold skipped: the motor is broken"
    with pytest.raises(BadInput, match="does not come next"):
        session.skip_calibration("calibration/patterns", "again")
    with pytest.raises(BadInput, match="training/0/0/1 is not a calibration"):
        session.skip_calibration("training/0/0/1", "again")
    assert settings_of(session).weakest_amplitude is None


def strength(protocol, responses, **haptics):
    return strength_of(protocol.calibration, PATTERNS, responses, HapticsConfig(**haptics))


def felt_above(threshold, count=20):
    """Return the responses of an observer without noise."""
    responses: list[Response] = []
    for _ in range(count):
        stimulus = next_stimulus("threshold", Calibration(stimuli=count), PATTERNS, responses, (1, 0))
        amplitude = stimulus.pattern.amplitude
        responses.append(Response("", amplitude, "felt" if amplitude >= threshold else "not felt"))
    return responses


def test_an_amplitude_that_cannot_be_set_stays_and_says_why(protocol):
    found = strength(protocol, felt_above(0.05))
    assert 0.1 < found.weakest_amplitude < 0.2 and "3 times the threshold of 0.0" in found.because
    for responses, haptics, because in (
        ([], {}, "as in the procedure: no threshold was measured on console"),
        (felt_above(0.05)[:-1], {}, "as in the procedure: no threshold was measured on console"),
        (felt_above(2.0), {}, "as in the procedure: the threshold is outside the amplitudes"),
        (felt_above(0.4), {}, "not below the strongest, 1.00"),
        (felt_above(0.2), {"max_amplitude": 0.5}, "not below the strongest, 0.50"),
    ):
        found = strength(protocol, responses, **haptics)
        assert found.weakest_amplitude is None and because in found.because


def test_a_stimulus_is_never_stronger_than_the_station_allows(session):
    limited = replace(HAPTICS, max_amplitude=0.05)
    assert session.stimulus(limited).pattern.amplitude <= 0.05
    stage = session.next().stage
    while (stimulus := session.stimulus(limited)) is not None and session.next().stage == stage:
        session.respond(stage.key, stimulus.number, "not felt", limited)
    rows = session.study.store.rows(select(CALIBRATION.c.amplitude))
    assert max(row["amplitude"] for row in rows) == 0.05


def test_a_protocol_without_calibration_keeps_the_settings_of_the_station(tmp_path):
    (tmp_path / "study.toml").write_text(SMALL)
    protocol = load_protocol(tmp_path)
    assert protocol.calibration is None
    assert strength(protocol, felt_above(0.05)).weakest_amplitude is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("stimuli = 20", "stimuli = 5"), "stimuli: expected 0 or at least 20, found 5"),
        (
            ("stimuli = 20", "stimuli = 0"),
            "times_threshold needs the threshold, which stimuli = 0 leaves out",
        ),
        (("max_rounds = 2", "max_rounds = 0"), "expected int >= 1, found 0"),
        (
            ("[calibration]", '[calibration]\ncondition = "seen"'),
            "unknown condition with haptic output 'seen'",
        ),
        (
            ("stimuli = 20\npresentations = 2", "stimuli = 0\npresentations = 0"),
            "stimuli and presentations are both 0; remove the table",
        ),
        (('title = "Seen and felt"', 'title = "Unfelt"\ntouch = false'), "no condition has haptic output"),
        (
            ("[training]", "[training]\nuntil_hits = 1"),
            "until_hits needs free = false: a hit does not end a free trial",
        ),
        (
            ("[training]", "[training]\nfree = false\nuntil_hits = 2"),
            "until_hits: 2 hits need as many trials; found 1",
        ),
        (('title = "Seen and felt"', 'title = "Felt"\nsham_duty = 0.3'), 'sham_duty needs touch = "sham"'),
        (('title = "Seen and felt"', 'title = "Felt"\ntouch = "shame"'), "touch: "),
    ],
)
def test_a_calibration_that_cannot_be_is_refused(tmp_path, change, message):
    text = CALIBRATED.replace(*change)
    assert text != CALIBRATED
    (tmp_path / "study.toml").write_text(text)
    with pytest.raises(BadInput) as error:
        load_protocol(tmp_path)
    assert message in str(error.value), str(error.value)


def test_a_sham_gets_the_seed_of_its_trial_and_keeps_the_guards_limits(tmp_path, store):
    text = SMALL.replace("touch = false", 'touch = "sham"\nsham_duty = 0.25')
    (tmp_path / "study.toml").write_text(text)
    study = Study(load_protocol(tmp_path), store)
    session = open_session(study, study.enrol(), "lab")
    settings = {}
    for _ in range(4):
        stage = go_to(session, "trial")
        settings[stage.condition, stage.trial] = session.config(Config()).haptics, stage.seed
        do_next(session)
    for number in (1, 2):
        sham, seed = settings["seen", number]
        assert (sham.sham_seed, sham.sham_duty, sham.max_amplitude) == (seed, 0.25, 1.0)
        assert settings["felt", number][0] == HapticsConfig()
    assert amplitude_range(PATTERNS) == (0.3, 1.0)
