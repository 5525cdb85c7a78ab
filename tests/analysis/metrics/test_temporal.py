"""Temporal claims against their definition."""

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
from haptigraph.run_report import RunReport

TIP, RETINA = "needle_tip", "retina_surface"
CONTACT = (TIP, "touching", RETINA)
SOON = Temporal("soon", when=(CONTACT,), feels=("pulse",), within_ms=50)
CALM = Temporal("calm", most_changes=2, in_ms=1000)


def step(ms: float, touching: bool, plays: bool, commanded_ms: float | None = None) -> Step:
    nodes = (Node("tip/1", TIP, "instrument"), Node("retina", RETINA, "anatomy"))
    edges = (Triplet("tip/1", "touching", "retina"),) if touching else ()
    stamp_ns = round(ms * MS)
    timing = None if commanded_ms is None else Timing(stamp_ns, round(commanded_ms * MS), {})
    made = make_step(PULSE if plays else OFF, stamp_ns=stamp_ns)
    return replace(made, graph=SceneGraph(stamp_ns, nodes, edges), timing=timing)


def watch(claim: Temporal, *steps: Step) -> Monitor:
    monitor = Monitor(claim)
    for one in steps:
        monitor.add(one)
    return monitor


def test_a_prompt_response_keeps_the_claim_and_its_delay_ends_with_the_command():
    result = watch(SOON, step(0, False, False), step(33, True, True, commanded_ms=45)).result
    assert (result.cases, result.broken, result.most) == (1, 0, 12.0)


def test_a_late_command_breaks_the_claim():
    monitor = Monitor(SOON)
    assert not monitor.add(step(0, False, False))
    assert monitor.add(step(33, True, True, commanded_ms=90))
    assert (monitor.result.broken, monitor.result.first_broken_ns, monitor.result.most) == (1, 33 * MS, 57.0)


def test_a_missing_response_breaks_the_claim_once_when_the_deadline_passes():
    monitor = Monitor(SOON)
    broken_now = [monitor.add(step(ms, True, False)) for ms in (0, 33, 66, 99)]
    assert broken_now == [False, False, True, False]
    assert monitor.result.broken == 1


def test_a_contact_that_ends_in_time_breaks_nothing_and_the_next_is_a_new_case():
    steps = [step(0, True, False), step(33, False, False), step(66, True, False), step(99, True, True)]
    result = watch(SOON, *steps).result
    assert (result.cases, result.broken, result.most) == (2, 0, 33.0)


def test_a_pattern_that_plays_already_has_no_delay():
    result = watch(SOON, step(0, False, True), step(33, True, True, commanded_ms=40)).result
    assert (result.cases, result.most) == (1, 0.0)


@given(st.lists(st.tuples(st.integers(1, 600), st.booleans()), min_size=1, max_size=40))
def test_changes_are_counted_in_every_window(parts):
    stamps, plays, now_ms = [], [], 0
    for wait_ms, is_playing in parts:
        now_ms += wait_ms
        stamps.append(now_ms)
        plays.append(is_playing)
    result = watch(CALM, *(step(ms, False, one) for ms, one in zip(stamps, plays, strict=True))).result
    changes = [at for at in range(1, len(plays)) if plays[at] != plays[at - 1]]
    windows = [sum(now - 1000 < stamps[at] <= now for at in changes) for now in stamps]
    assert result.most == max(windows)
    assert result.cases == len(changes)
    over = [count > 2 for count in windows]
    assert result.broken == sum(one and not before for before, one in zip([False, *over], over, strict=False))


def test_a_run_that_begins_in_silence_has_lost_nothing():
    silent = Temporal("silent", absent=(TIP,), feels=("off",), within_ms=50)
    empty = SceneGraph(0, (), ())
    first = replace(step(0, False, False, commanded_ms=400), graph=empty)
    assert not Monitor(silent).add(first)
    late = replace(step(0, False, True, commanded_ms=400), graph=replace(step(0, True, True).graph))
    assert Monitor(SOON).add(late)  # an alarm is not felt before it is commanded


def test_there_is_a_line_per_claim():
    broken = watch(SOON, step(1000, False, False), step(1033, True, True, commanded_ms=1100)).result
    assert claim_lines([broken, watch(CALM).result], 1000 * MS) == [
        "claim           soon: BROKEN 1 x, first at 0.03 s, at most 67 ms",
        "claim           calm: not exercised",
    ]


def test_the_summary_of_a_run_has_the_claims_of_its_procedure(procedure):
    measures = RunMeasures.under(procedure)
    assert [one.name for one in measures.claims] == [claim.name for claim in procedure.temporal] != []
    for at in range(12):
        measures.add(step(1000 + 33 * at, False, at % 2 == 1))
        assert bool(measures.just_broken) == (at == 7)
    (line,) = (line for line in summary(measures).splitlines() if "BROKEN" in line)
    assert line.endswith("no more than 6 times in a second: BROKEN 1 x, first at 0.23 s, at most 11 changes")


def test_without_temporal_claims_the_summary_has_none():
    assert "claim" not in summary(RunMeasures())


@pytest.mark.parametrize("late", [False, True])
def test_premises_may_concern_entities(late):
    lost = Temporal("silent", absent=(TIP,), feels=("off",), within_ms=50)
    second = replace(make_step(PULSE if late else OFF, stamp_ns=60 * MS), graph=SceneGraph(60 * MS))
    first = replace(make_step(PULSE, stamp_ns=0), graph=SceneGraph(0))
    result = watch(lost, first, second).result
    assert result.broken == 1
    assert result.most == 60.0


def test_a_run_that_is_slower_than_real_time_says_by_how_much(procedure):
    report = RunReport(steps=700, duration_s=100.0, wall_s=100.0)
    assert "slower" not in summary(RunMeasures.under(procedure), report)
    for _ in range(700):
        report.add_late(110_000_000)
    text = summary(RunMeasures.under(procedure), report)
    assert "pace            slower than real time: 23.0 s of images took 100.0 s\n" in text
    assert "700 late" in text
