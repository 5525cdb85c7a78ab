"""Claims about time, held against their plain reading."""

import pytest
from helpers import MS, PULSE, make_step
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.metrics.summary import summary
from haptigraph.analysis.metrics.temporal import Monitor, claim_lines
from haptigraph.graph import Node, SceneGraph, Triplet
from haptigraph.inference.claims import Temporal
from haptigraph.messages import OFF, Step, Timing

TIP, RETINA = "needle_tip", "retina_surface"
TOUCH = (TIP, "touching", RETINA)
SOON = Temporal("soon", when=(TOUCH,), feels=("pulse",), within_ms=50)
CALM = Temporal("calm", most_changes=2, in_ms=1000)


def step(ms: float, touching: bool, felt: bool, handed_ms: float | None = None) -> Step:
    nodes = (Node("tip/1", TIP, "instrument"), Node("retina", RETINA, "anatomy"))
    edges = (Triplet("tip/1", "touching", "retina"),) if touching else ()
    stamp_ns = round(ms * MS)
    timing = None if handed_ms is None else Timing(stamp_ns, round(handed_ms * MS), {})
    made = make_step(PULSE if felt else OFF, stamp_ns=stamp_ns)
    return replace(made, graph=SceneGraph(stamp_ns, nodes, edges), timing=timing)


def watch(claim: Temporal, *steps: Step) -> Monitor:
    monitor = Monitor(claim)
    for one in steps:
        monitor.add(one)
    return monitor


def test_what_is_felt_at_once_is_kept_and_the_wait_is_until_it_was_handed_on():
    kept = watch(SOON, step(0, False, False), step(33, True, True, handed_ms=45)).kept
    assert (kept.cases, kept.broken, kept.most) == (1, 0, 12.0)


def test_what_is_handed_on_too_late_is_broken():
    monitor = Monitor(SOON)
    assert not monitor.add(step(0, False, False))
    assert monitor.add(step(33, True, True, handed_ms=90))
    assert (monitor.kept.broken, monitor.kept.first_broken_ns, monitor.kept.most) == (1, 33 * MS, 57.0)


def test_what_is_never_felt_is_broken_once_as_soon_as_the_time_has_run_out():
    monitor = Monitor(SOON)
    told = [monitor.add(step(ms, True, False)) for ms in (0, 33, 66, 99)]
    assert told == [False, False, True, False]
    assert monitor.kept.broken == 1


def test_a_touch_that_ends_in_time_breaks_nothing_and_the_next_begins_anew():
    steps = [step(0, True, False), step(33, False, False), step(66, True, False), step(99, True, True)]
    kept = watch(SOON, *steps).kept
    assert (kept.cases, kept.broken, kept.most) == (2, 0, 33.0)


def test_what_was_felt_already_makes_no_wait():
    kept = watch(SOON, step(0, False, True), step(33, True, True, handed_ms=40)).kept
    assert (kept.cases, kept.most) == (1, 0.0)


@given(st.lists(st.tuples(st.integers(1, 600), st.booleans()), min_size=1, max_size=40))
def test_changes_are_counted_in_every_window(parts):
    stamps, felt, now_ms = [], [], 0
    for wait_ms, is_felt in parts:
        now_ms += wait_ms
        stamps.append(now_ms)
        felt.append(is_felt)
    kept = watch(CALM, *(step(ms, False, one) for ms, one in zip(stamps, felt, strict=True))).kept
    changes = [at for at in range(1, len(felt)) if felt[at] != felt[at - 1]]
    windows = [sum(now - 1000 < stamps[at] <= now for at in changes) for now in stamps]
    assert kept.most == max(windows)
    assert kept.cases == len(changes)
    over = [count > 2 for count in windows]
    assert kept.broken == sum(one and not before for before, one in zip([False, *over], over, strict=False))


def test_lines_say_how_each_claim_was_kept():
    broken = watch(SOON, step(1000, False, False), step(1033, True, True, handed_ms=1100)).kept
    assert claim_lines([broken, watch(CALM).kept], 1000 * MS) == [
        "claim           soon: BROKEN 1 x, first at 0.03 s, at most 67 ms",
        "claim           calm: kept, never put to the test",
    ]


def test_the_summary_of_a_run_tells_the_claims_of_its_procedure(procedure):
    measures = RunMeasures.under(procedure)
    assert [one.name for one in measures.claims] == [claim.name for claim in procedure.temporal] != []
    for at in range(12):
        measures.add(step(1000 + 33 * at, False, at % 2 == 1))
        assert bool(measures.just_broken) == (at == 7)
    (line,) = (line for line in summary(measures).splitlines() if "BROKEN" in line)
    assert line.endswith("no more than 6 times in a second: BROKEN 1 x, first at 0.23 s, at most 11 changes")


def test_a_procedure_without_such_claims_says_nothing_of_them():
    assert "claim" not in summary(RunMeasures())


@pytest.mark.parametrize("late", [False, True])
def test_first_parts_read_entities_too(late):
    lost = Temporal("silent", absent=(TIP,), feels=("off",), within_ms=50)
    empty = replace(make_step(PULSE if late else OFF, stamp_ns=60 * MS), graph=SceneGraph(60 * MS))
    first = replace(make_step(PULSE, stamp_ns=0), graph=SceneGraph(0))
    kept = watch(lost, first, empty).kept
    assert kept.broken == 1
    assert kept.most == 60.0
