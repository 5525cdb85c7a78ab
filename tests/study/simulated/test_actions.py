"""What simulated participants answer, and how their trials are set up."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.study.plan import Stage, plan_of
from haptigraph.study.questionnaire import Item, load_questionnaire
from haptigraph.study.simulated.actions import act_of, answer_of, rehearse
from haptigraph.study.simulated.participant import draw_participant

SHEET = Stage("questionnaire", "seen", 1, questionnaire="sus")
bounds = st.none() | st.integers(-1000, 1000) | st.floats(-1000, 1000)
items = st.one_of(
    st.builds(Item, st.just("a"), st.just("b"), st.just("text")),
    st.builds(
        Item,
        st.just("a"),
        st.just("b"),
        st.just("choice"),
        choices=st.lists(st.sampled_from("uvwxyz"), min_size=2, unique=True).map(tuple),
    ),
    st.builds(Item, st.just("a"), st.just("b"), st.just("scale"), st.integers(-9, 0), st.integers(1, 9)),
    st.builds(Item, st.just("a"), st.just("b"), st.just("number"), bounds, bounds).filter(
        lambda item: item.low is None or item.high is None or item.low <= item.high
    ),
)


@given(items, st.integers(0, 2**32), st.sampled_from(["S01", "S02"]))
def test_an_answer_is_one_that_the_item_takes(item, seed, participant):
    answer = answer_of(item, seed, participant, SHEET)
    assert item.checked(answer) == answer == answer_of(item, seed, participant, SHEET)


def test_answers_know_no_condition_and_take_every_value_equally_often():
    sheet = load_questionnaire("sus")
    answers = []
    for number in range(200):
        for item in sheet.items:
            answer = answer_of(item, 1, f"S{number}", SHEET)
            assert answer == answer_of(item, 1, f"S{number}", replace(SHEET, condition="felt"))
            answers.append(answer)
    counts = [answers.count(value) for value in "12345"]
    assert sum(counts) == 2000 and all(330 < count < 470 for count in counts)  # 400 ± 4 SD


def test_a_trial_has_its_target_its_touch_and_its_time(protocol):
    for stage in (stage for stage in plan_of(protocol, 0) if stage.kind == "trial"):
        rehearsal = rehearse(act_of(protocol, replace(stage, timeout_s=0.5)), draw_participant(1, 0), 1)
        assert rehearsal.config.haptics.max_amplitude == (stage.condition == "felt")
        target_mm = rehearsal.registration.target.at_mm
        assert (target_mm[0] < 0) == (stage.target == "left")
        assert len(list(rehearsal.steps())) == 15 + 1  # and the end of the source
        assert not rehearsal.is_hit


def test_who_cannot_do_it_says_so(folder, protocol):
    act = act_of(protocol, next(stage for stage in plan_of(protocol, 0) if stage.is_trial))
    peeling = replace(act, condition=replace(act.condition, procedure="membrane_peeling", text=""))
    with pytest.raises(BadInput, match="membrane_peeling: has no state target_hit; simulated participants"):
        rehearse(peeling, draw_participant(1, 0), 1)
