"""What comes next, from stored attempts and answers alone."""

from datetime import UTC, datetime, timedelta

import pytest
from msgspec.structs import replace

from haptigraph.study.plan import Stage
from haptigraph.study.progress import Attempt, Next, Progress, next_of, repeatable
from haptigraph.study.protocol import Stop
from haptigraph.study.runner import open_session

CONSENT = Stage("consent")
FIRST, SECOND, THIRD = (Stage("trial", "felt", 1, block=1, trial=number) for number in (1, 2, 3))
SUS = Stage("questionnaire", "felt", 1, questionnaire="sus")
PLAN = (CONSENT, FIRST, SECOND, THIRD, SUS)
AT = datetime(2026, 11, 21, 9, tzinfo=UTC)


def hit(number=1, outcome="hit", void=None):
    """An attempt; aborted ones never count."""
    return Attempt(number, outcome, "aborted" if outcome == "aborted" else void, f"{number}.mcap")


def key(stage):
    return stage.kind, stage.position, stage.block, stage.trial


def progress_with(*attempts, done=("consent",), **fields):
    """Progress with these lists of attempts at the first, second and third trial."""
    trials = {key(stage): list(each) for stage, each in zip(PLAN[1:], attempts, strict=False)}
    return Progress(AT.isoformat(), fields.pop("withdrawn", ""), set(done), attempts=trials, **fields)


@pytest.fixture
def upcoming(protocol):
    def what_comes_next(progress, minutes=0.0, **stop):
        rules = replace(protocol, stop=Stop(**stop))
        return next_of(PLAN, progress, rules, AT + timedelta(minutes=minutes))

    return what_comes_next


def test_a_participant_begins_with_the_first_stage(upcoming):
    assert upcoming(progress_with(done=())) == Next(CONSENT, 0, 5)


def test_a_trial_comes_with_the_number_of_its_attempt(upcoming):
    assert upcoming(progress_with()) == Next(FIRST, 1, 5, attempt=1)
    assert upcoming(progress_with([hit(1, "aborted")])) == Next(FIRST, 1, 5, attempt=2)
    assert upcoming(progress_with([hit(1, void="the phone rang")])) == Next(FIRST, 1, 5, attempt=2)
    assert upcoming(progress_with([hit()])) == Next(SECOND, 2, 5, attempt=1)


def test_a_trial_that_has_begun_is_running(upcoming):
    running = [hit(1, "aborted"), hit(2, outcome=None)]
    assert upcoming(progress_with(running)) == Next(FIRST, 1, 5, attempt=2, running=True)


def test_a_questionnaire_comes_with_its_answers_so_far(upcoming):
    answers = {("sus", 1): {"sus_1": "4"}, ("sus", 2): {"sus_1": "1"}}
    progress = progress_with([hit()], [hit()], [hit()], answers=answers)
    assert upcoming(progress) == Next(SUS, 4, 5, answers={"sus_1": "4"})


def test_a_session_ends_with_the_plan_with_a_stop_or_when_the_participant_withdraws(upcoming):
    all_done = progress_with([hit()], [hit()], [hit()], done=("consent", SUS.key))
    assert upcoming(all_done) == Next(None, 5, 5, ended="all is done")
    assert upcoming(progress_with([hit()], stopped="felt dizzy")) == Next(
        None, 2, 5, ended="stopped: felt dizzy"
    )
    all_done.withdrawn = "has left"
    assert upcoming(all_done) == Next(None, 5, 5, ended="has left")
    assert upcoming(progress_with([hit()], withdrawn="has left")) == Next(None, 2, 5, ended="has left")


def test_only_timeouts_in_a_row_end_a_session(upcoming):
    timeout = [hit(1, "timeout")]
    assert upcoming(progress_with([hit()], timeout), timeouts_in_a_row=2).stage == THIRD
    assert upcoming(progress_with(timeout, [hit()]), timeouts_in_a_row=2).stage == THIRD
    assert upcoming(progress_with(timeout, [hit()]), timeouts_in_a_row=1).stage == THIRD
    ended = upcoming(progress_with(timeout, timeout), timeouts_in_a_row=2).ended
    assert ended == "stopped: 2 timeouts in a row"


def test_a_failed_trial_interrupts_timeouts_in_a_row(upcoming):
    failed = [hit(1, "aborted"), hit(2, "aborted")]
    assert upcoming(progress_with([hit(1, "timeout")], failed), timeouts_in_a_row=2).stage == THIRD
    assert upcoming(progress_with(failed), failed_trials=2).stage == SECOND
    assert upcoming(progress_with(failed), failed_trials=1).ended == "stopped: failed trials: 1"


def test_a_trial_may_begin_until_the_time_of_the_session_is_over(upcoming):
    assert upcoming(progress_with(), 30, session_min=30).stage == FIRST
    late = upcoming(progress_with(), 30.01, session_min=30)
    assert (late.stage, late.ended) == (None, "stopped: 30 minutes have passed")


def test_a_break_for_a_trial_that_will_not_come_is_left_out(protocol):
    plan, rules = (FIRST, Stage("break", position=2)), replace(protocol, stop=Stop(session_min=30))
    upcoming = next_of(plan, progress_with([hit()]), rules, AT + timedelta(minutes=31))
    assert upcoming == Next(None, 1, 2, ended="stopped: 30 minutes have passed")


def test_the_time_of_the_session_does_not_end_a_questionnaire(upcoming):
    progress = progress_with([hit()], [hit()], [hit()])
    assert upcoming(progress, 31, session_min=30).stage == SUS


@pytest.mark.parametrize(
    ("outcomes", "failed"),
    [
        (["aborted"], False),
        (["aborted", "aborted"], True),
        (["hit", "aborted", "aborted"], True),
        (["aborted", "aborted", "hit"], False),
        (["aborted", "hit", "aborted"], False),  # repeated in between
        (["aborted", "hit", "aborted", "aborted"], True),
        (["hit", "hit", "hit", "aborted"], False),
    ],
)
def test_a_trial_has_failed_after_as_many_aborted_attempts_as_allowed_unless_the_last_was_not(
    outcomes, failed
):
    attempts = [hit(number, outcome) for number, outcome in enumerate(outcomes, 1)]
    assert progress_with(attempts).has_failed(FIRST, 2) is failed


def test_a_trial_that_was_left_by_an_earlier_rule_stays_behind(upcoming):
    """Version 0.1 counted the aborted attempts before and after a repeat together."""
    left = [hit(1, "aborted"), hit(2, void="again"), hit(3, "aborted")]
    assert upcoming(progress_with(left)) == Next(FIRST, 1, 5, attempt=4)
    assert upcoming(progress_with(left, [hit()])) == Next(THIRD, 3, 5, attempt=1)


def test_the_preceding_trial_may_be_repeated_until_the_next_stage_has_begun(upcoming):
    def may_repeat(progress):
        return repeatable(PLAN, progress, upcoming(progress))

    assert may_repeat(progress_with([hit()])) == FIRST
    assert may_repeat(progress_with([hit()], [hit(1, outcome=None)])) is None
    assert may_repeat(progress_with([hit(1, "aborted"), hit(2, "aborted")])) is None
    assert may_repeat(progress_with(done=())) is None
    assert may_repeat(progress_with()) is None
    answers = {("sus", 1): {"sus_1": "4"}}
    full = [hit()], [hit()], [hit()]
    assert may_repeat(progress_with(*full)) == THIRD
    assert may_repeat(progress_with(*full, answers=answers)) is None


def test_a_plan_that_ends_in_a_trial_leaves_nothing_to_repeat_at_its_begin(protocol):
    plan = (FIRST, SECOND)
    progress = progress_with([], [hit()], done=())
    upcoming = next_of(plan, progress, protocol, AT)
    assert (upcoming.stage, repeatable(plan, progress, upcoming)) == (FIRST, None)


def test_a_stop_ends_the_session_of_its_participant_alone(study):
    first, second = (open_session(study, study.enrol(), station) for station in ("one", "two"))
    first.stop("feels sick")
    assert first.next().ended == "stopped: feels sick"
    assert second.next().ended == ""


TRAINING = tuple(Stage("training", "felt", 1, trial=number) for number in (1, 2, 3, 4))


@pytest.mark.parametrize(
    ("outcomes", "next_trial"),
    [
        ([], 1),
        (["hit"], 2),
        (["hit", "hit"], None),
        (["hit", "timeout", "hit"], 4),
        (["timeout", "hit", "hit"], None),
        (["timeout", "hit", "timeout", "hit"], None),
    ],
)
def test_training_ends_after_so_many_hits_in_a_row_or_with_its_last_trial(protocol, outcomes, next_trial):
    plan = (*TRAINING, FIRST)
    attempts = {key(stage): [hit(1, outcome)] for stage, outcome in zip(TRAINING, outcomes, strict=False)}
    progress = Progress(AT.isoformat(), "", set(), attempts=attempts)
    rules = replace(protocol, training=replace(protocol.training, until_hits=2, trials=4))
    upcoming = next_of(plan, progress, rules, AT)
    assert upcoming.stage == (TRAINING[next_trial - 1] if next_trial else FIRST)
    assert upcoming.done == (next_trial - 1 if next_trial else 4)


def test_training_before_each_condition_has_a_criterion_of_its_own_and_void_hits_do_not_count(protocol):
    other = tuple(Stage("training", "seen", 2, trial=number) for number in (1, 2))
    plan = (*TRAINING[:2], *other)
    rules = replace(protocol, training=replace(protocol.training, until_hits=1, trials=2))
    attempts = {key(TRAINING[0]): [hit(1, void="slipped"), hit(2)]}
    assert next_of(plan, Progress(None, "", set(), attempts=attempts), rules, AT).stage == other[0]
    attempts = {key(TRAINING[0]): [hit(1, void="slipped")]}
    assert next_of(plan, Progress(None, "", set(), attempts=attempts), rules, AT).stage == TRAINING[0]
