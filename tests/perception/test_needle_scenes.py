"""Simulated scenes in which tips were reported with certainty where none was, or none where one was plain."""

import math

import pytest

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import Point, subtract
from haptigraph.messages import Capture
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.sweep_scenes import sweep_scene

FAR_MM, DEEP_MM = 0.3, 2.0


@pytest.mark.parametrize(
    ("number", "seed", "max_unknown", "max_far"),
    [(15, 105, 3, 1), (11, 105, 0, 0), (65, 101, 0, 0), (10, 326, 0, 3), (5, 328, 7, 0)],
    ids=[
        "out of a white cannula",
        "before a wall of unknown background",
        "as bright as an orange bowl",
        "across a bubble as bright as the shaft",
        "towards a bubble in line with the shaft",
    ],
)
def test_tips_are_known_where_they_are_plain(number, seed, max_unknown, max_far):
    phantom = Phantom(sweep_scene(number, seed).scenario)
    registration = parse_camera_registration(phantom.registration, "the scene's registration")
    tracker, deep, unknown, far = Tracker(registration, PerceptionConfig()), 0, 0, 0
    phantom.restart()
    for index in range(phantom.images):
        moment = phantom.advance()
        assert moment is not None
        tip = tracker(Capture(index, round(moment.time_s * 1e9), moment.image)).found.get("needle_tip")
        if not moment.truth.visible or moment.truth.depth_mm < DEEP_MM:
            continue
        deep += 1
        unknown += tip is None
        if isinstance(tip, Point):
            off_px = subtract(registration.image.to_px(tip.at_mm), moment.truth.tip_px)
            far += math.hypot(*off_px) * registration.image.mm_per_px > FAR_MM
    assert deep >= 10
    assert unknown <= max_unknown
    assert far <= max_far
