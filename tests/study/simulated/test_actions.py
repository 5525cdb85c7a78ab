"""Answers and trials of simulated participants."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.study.plan import Stage, plan_of
from haptigraph.study.questionnaire import Item, load_questionnaire
from haptigraph.study.simulated.actions import answer_to, rehearse, trial_spec
from haptigraph.study.simulated.participant import draw_participant

SUS = Stage("questionnaire", "seen", 1, questionnaire="sus")
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
def test_answers_are_valid(item, seed, participant):
    answer = answer_to(item, seed, participant, SUS)
    assert item.checked(answer) == answer == answer_to(item, seed, participant, SUS)


def test_answers_do_not_depend_on_the_condition_and_are_uniformly_distributed():
    questionnaire = load_questionnaire("sus")
    answers = []
    for number in range(200):
        for item in questionnaire.items:
            answer = answer_to(item, 1, f"S{number}", SUS)
            assert answer == answer_to(item, 1, f"S{number}", replace(SUS, condition="felt"))
            answers.append(answer)
    counts = [answers.count(value) for value in "12345"]
    assert sum(counts) == 2000 and all(330 < count < 470 for count in counts)  # 400 ± 4 SD


def test_a_trial_has_the_target_the_haptics_and_the_timeout_of_the_protocol(protocol):
    for stage in (stage for stage in plan_of(protocol, 0) if stage.kind == "trial"):
        rehearsal = rehearse(trial_spec(protocol, replace(stage, timeout_s=0.5)), draw_participant(1, 0), 1)
        assert rehearsal.config.haptics.max_amplitude == (stage.condition == "felt")
        target_mm = rehearsal.registration.target.at_mm
        assert (target_mm[0] < 0) == (stage.target == "left")
        assert len(list(rehearsal.steps())) == 15 + 1  # with the end of the source
        assert not rehearsal.is_hit


def test_a_sham_of_the_protocol_is_a_sham_without_a_session_too(folder, protocol):
    seen = protocol.condition("seen")
    others = tuple(each for each in protocol.conditions if each != seen)
    protocol = replace(protocol, conditions=(replace(seen, touch="sham", sham_duty=0.2), *others))
    for stage in (stage for stage in plan_of(protocol, 0) if stage.kind == "trial"):
        haptics = rehearse(trial_spec(protocol, stage), draw_participant(1, 0), 1).config.haptics
        is_sham = stage.condition == "seen"
        assert (haptics.sham_seed, haptics.max_amplitude) == (stage.seed if is_sham else None, 1.0)
        assert haptics.sham_duty == (0.2 if is_sham else 0.5)


def test_a_procedure_without_a_target_is_refused(folder, protocol):
    spec = trial_spec(protocol, next(stage for stage in plan_of(protocol, 0) if stage.is_trial))
    peeling = replace(spec, condition=replace(spec.condition, procedure="membrane_peeling", text=""))
    with pytest.raises(BadInput, match="membrane_peeling: has no state target_hit; simulated participants"):
        rehearse(peeling, draw_participant(1, 0), 1)
