from collections import Counter
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import update

import haptigraph
from haptigraph.checksum import hashed_integer
from haptigraph.study.conditions import order_of, shuffled, targets_of, williams
from haptigraph.study.plan import condition_title, conditions_of, inseparable, plan_of
from haptigraph.study.protocol import load_protocol
from haptigraph.study.roster import Study
from haptigraph.study.store import Store
from haptigraph.study.tables import STUDIES

PAPER = Path(haptigraph.__file__).parent / "study" / "templates"
SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("count", range(1, 10))
def test_a_williams_square_balances_positions_and_successors(count):
    rows = williams(count)
    assert all(sorted(row) == list(range(count)) for row in rows)
    for position in range(count):
        assert len(set(Counter(row[position] for row in rows).values())) == 1
    successors = Counter(pair for row in rows for pair in pairwise(row))
    assert len(successors) == count * (count - 1)
    assert len(set(successors.values())) <= 1


@given(SEEDS, st.integers(2, 6), st.integers(0, 20))
def test_every_full_round_of_participants_is_balanced(seed, count, round_):
    rows = len(williams(count))
    orders = [
        tuple(order_of(range(count), round_ * rows + n, seed, "balanced", "conditions")) for n in range(rows)
    ]
    assert sorted(orders) == sorted(williams(count))


@given(
    SEEDS,
    st.integers(1, 6),
    st.integers(0, 40),
    st.sampled_from(["balanced", "random", "fixed"]),
    st.integers(1, 30),
)
def test_targets_change_on_every_trial_and_all_occur_before_any_repeats(seed, count, slot, order, trials):
    names = [f"t{number}" for number in range(count)]
    targets = targets_of(names, trials, slot, seed, order)
    assert len(targets) == trials
    for start in range(0, trials - count + 1, count):
        assert sorted(targets[start : start + count]) == names
    if count > 1:
        assert all(a != b for a, b in pairwise(targets))


def test_hashed_numbers_never_change():
    assert hashed_integer(2026, "conditions") == 8710794228100117704  # computed with sha256sum
    assert shuffled("abcdef", 1) == ["d", "a", "b", "f", "c", "e"]


def test_the_papers_study_uses_each_order_and_each_target_equally_often():
    protocol = load_protocol(PAPER)
    orders = Counter(tuple(conditions_of(protocol, slot)) for slot in range(16))
    assert set(orders.values()) == {8} and len(orders) == 2
    trials = [stage for slot in range(16) for stage in plan_of(protocol, slot) if stage.kind == "trial"]
    assert set(Counter((stage.condition, stage.target) for stage in trials).values()) == {4}
    assert len({stage.seed for stage in trials}) == 32


def trials_of(protocol, plan):
    slots = range(protocol.study.participants)
    return [stage for slot in slots for stage in plan(slot) if stage.kind == "trial"]


def confounded(trials):
    return inseparable((stage.condition, stage.target) for stage in trials)


def small_design(tmp_path, seed, repetitions=2, participants=2):
    text = (PAPER / "study.toml").read_text().replace("seed = 2026", f"seed = {seed}")
    text = text.replace("participants = 16", f"participants = {participants}")
    (tmp_path / "study.toml").write_text(text.replace("repetitions = 1 ", f"repetitions = {repetitions} "))
    return load_protocol(tmp_path)


@pytest.mark.parametrize("seed", [2026, 2, 3, 7, 1, 4])
@pytest.mark.parametrize("repetitions", [1, 2])
def test_targets_are_balanced_over_conditions_in_a_small_study_too(tmp_path, seed, repetitions):
    protocol = small_design(tmp_path, seed, repetitions)
    trials = trials_of(protocol, lambda slot: plan_of(protocol, slot))
    counts = Counter((stage.condition, stage.target) for stage in trials)
    for target in {stage.target for stage in trials}:
        assert counts["visual_only", target] == counts["visual_haptic", target] == 1
    assert not confounded(trials)


def test_a_study_that_0_1_froze_keeps_its_targets(tmp_path):
    protocol = small_design(tmp_path, 2026)
    with closing(Store(tmp_path / "study.db")) as store:
        study = Study(protocol, store)
        study.enrol()
        plan = study.planner()
        assert plan(0) == plan_of(protocol, 0) and not confounded(trials_of(protocol, plan))
        with store.begin() as connection:
            connection.execute(update(STUDIES).values(software="0.1.0"))
        found = confounded(trials_of(protocol, study.planner()))
    assert found == "far_right, right only under visual_haptic; left, middle only under visual_only"


def test_the_papers_protocol_has_the_stages_of_the_paper():
    protocol = load_protocol(PAPER)
    kinds = [stage.kind for stage in plan_of(protocol, 0)]
    assert kinds == [
        "briefing",
        "consent",
        "questionnaire",
        "training",
        "trial",
        "questionnaire",
        "break",
        "trial",
        "questionnaire",
        "thanks",
    ]
    assert (protocol.study.participants, protocol.study.design) == (16, "within")
    assert [condition.touch for condition in protocol.conditions] == [False, True]


def test_between_subjects_each_completes_one_condition_and_all_occur_equally_often(folder, protocol):
    text = protocol.parts["study.toml"].replace('"within"', '"between"').replace('condition = "felt"\n', "")
    for order in ("balanced", "fixed"):
        (folder / "study.toml").write_text(text.replace("seed = 1", f'seed = 1\norder = "{order}"'))
        between = load_protocol(folder)
        conditions = [conditions_of(between, slot) for slot in range(4)]
        assert Counter(name for (name,) in conditions) == {"seen": 2, "felt": 2}
        training = [
            stage.condition
            for slot in range(4)
            for stage in plan_of(between, slot)
            if stage.kind == "training"
        ]
        assert training == [name for (name,) in conditions]


@pytest.mark.parametrize(
    ("blind", "participant", "experimenter"),
    [
        ("nobody", "Seen only", "Seen only"),
        ("participant", "condition 1", "Seen only"),
        ("everyone", "condition 1", "condition 1"),
    ],
)
def test_blinding_hides_the_condition(folder, protocol, blind, participant, experimenter):
    text = protocol.parts["study.toml"].replace("seed = 1", f'seed = 1\nblind = "{blind}"\norder = "fixed"')
    (folder / "study.toml").write_text(text)
    blinded = load_protocol(folder)
    trial = next(stage for stage in plan_of(blinded, 0) if stage.kind == "trial")
    assert condition_title(blinded, trial, "participant") == participant
    assert condition_title(blinded, trial, "experimenter") == experimenter
