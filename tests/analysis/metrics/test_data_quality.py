"""The quality of a trial's data, from steps of which some are late, skipped, without image or without tip."""

import pytest
from msgspec.structs import replace

from haptigraph.analysis.metrics.data_quality import DataQuality
from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.geometry import Point
from haptigraph.graph import SceneGraph, Triplet
from haptigraph.inference.span import RunSpan
from haptigraph.messages import OFF, Conclusion, HapticCommand, Observation, Step

INSIDE = Triplet("needle_tip", "inside", "eye_globe")


def quality_of(rows, *, inside=True, tip="needle_tip"):
    """Measure rows (milliseconds, number of the image, whether the tip is visible[, state])."""
    run = RunMeasures(span=RunSpan(begins=(tip, "inside", "eye_globe")))
    quality = DataQuality(run)
    for ms, index, is_visible, *state in rows:
        stamp_ns = ms * 1_000_000
        found = {tip: Point((0.0, 0.0))} if is_visible else {}
        edges = (replace(INSIDE, subject=tip),) if inside and is_visible else ()
        conclusion = Conclusion(stamp_ns, state[0] if state else "navigating", 1, "off", "")
        step = Step(
            index,
            stamp_ns,
            Observation(stamp_ns, found),
            SceneGraph(stamp_ns, (), edges),
            conclusion,
            HapticCommand(stamp_ns, OFF, 0),
        )
        run.add(step)
        quality.add(step)
    return quality.measures()


def test_an_even_run_has_no_problem():
    rows = [(ms, number, True) for number, ms in enumerate(range(0, 1001, 25))]
    assert quality_of(rows) == {
        "images_per_s": 40.0,
        "late_images_fraction": 0.0,
        "skipped_images": 0,
        "unseen_fraction": 0.0,
        "long_gaps": 0,
        "longest_gap_s": 0.025,
    }


def test_late_skipped_missing_and_unseen_images_are_told_apart():
    rows = [
        *((0, 0, True), (100, 1, True), (200, 2, False), (300, 3, True)),
        (450, 4, True),  # just in time
        (700, 7, True),  # late, as two were skipped
        (800, 7, False),  # no image for 100 ms
        *((900, 8, True), (1000, 9, True)),
    ]
    assert quality_of(rows) == {
        "images_per_s": 7.0,
        "late_images_fraction": pytest.approx(2 / 7),
        "skipped_images": 2,
        "unseen_fraction": pytest.approx(0.2),
        "long_gaps": 0,
        "longest_gap_s": 0.25,
    }


@pytest.mark.parametrize("gap_ms", [(0, 600), (200, 800), (400, 1000)])
def test_gaps_count_from_image_to_image_and_to_the_ends_of_the_run(gap_ms):
    start, end = gap_ms
    rows = [(ms, ms // 20, ms == 0 or not start < ms < end) for ms in range(0, 1001, 20)]
    rows = [row if row[0] < 1000 else (1000, 50, end < 1000) for row in rows]
    assert quality_of(rows)["longest_gap_s"] == pytest.approx((end - start) / 1000)
    assert quality_of(rows)["long_gaps"] == 1


def test_only_the_run_counts_and_without_one_the_whole_trial():
    before = [(ms, ms // 100, False) for ms in range(0, 2000, 100)]
    run = [(ms, ms // 100, True) for ms in range(2000, 3000, 100)]
    after = [(3000, 30, True, "target_hit"), (9000, 31, False, "unknown")]
    for tip in ("needle_tip", "forceps_tip"):
        found = quality_of([*before, *run, *after], tip=tip)
        assert found["unseen_fraction"] == 0.0 and found["longest_gap_s"] == pytest.approx(0.1)
    never = quality_of([*before, *run, *after], inside=False)
    assert never["longest_gap_s"] == 6.0 and never["unseen_fraction"] == pytest.approx(2 / 9)
    unseen = quality_of(before)
    assert unseen["unseen_fraction"] == 1.0 and unseen["longest_gap_s"] == pytest.approx(1.9)


def test_a_frozen_camera_has_no_images_and_a_single_step_no_quality():
    frozen = quality_of([(0, 0, True), *((ms, 0, False) for ms in range(100, 1001, 100))])
    assert frozen["images_per_s"] == 0.0 and frozen["late_images_fraction"] == 1.0
    assert quality_of([(0, 0, True)]) == {} == quality_of([])
