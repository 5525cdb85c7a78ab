"""Every perceiver, a sink and the other stages fulfil their contracts."""

import io
from typing import get_args

import numpy as np
import pytest
from helpers import LOW, make_step, observe, on_axis

from haptigraph import assemble
from haptigraph.config import Config
from haptigraph.errors import EndOfSource, MissingExtra
from haptigraph.geometry import Point, Segment
from haptigraph.haptics.renderer import GrammarRenderer
from haptigraph.inference.engine import RuleEngine
from haptigraph.messages import Capture, ImageKind
from haptigraph.scene.builder import SchemaSceneBuilder
from haptigraph.sinks.console import ConsoleSink
from haptigraph.sources.phantom import PhantomSource
from haptigraph.stages import Perceiver, PerceiverClass, Reasoner, Renderer, SceneBuilder, Sink

WIDEST_MM = 0.5
"""Of a needle."""
IMAGES_OF = {"eye": "eye_images", "bscan": "scan_images", "volume": "volume_images"}


def captures_of(name):
    source, captures = PhantomSource(name), []
    try:
        while True:
            captures.append(source.read(1.0))
    except EndOfSource:
        return source.registration, captures


@pytest.fixture(scope="module")
def eye_images(quick):
    return captures_of(quick)


@pytest.fixture(scope="module")
def scan_images(quick_scan):
    return captures_of(quick_scan)


@pytest.fixture(scope="module")
def volume_images(quick_volume):
    return captures_of(quick_volume)


@pytest.fixture(params=assemble.PERCEIVERS)
def perceiver_class(request):
    return assemble._named(assemble.PERCEIVERS, "perceiver", request.param)


@pytest.fixture
def phantom_images(request, perceiver_class):
    """Of the phantom that the perceiver is for."""
    return request.getfixturevalue(IMAGES_OF[perceiver_class.images])


@pytest.fixture
def perceiver(perceiver_class, phantom_images):
    from haptigraph.registration.loading import parse_registration

    try:
        return perceiver_class(parse_registration(phantom_images[0], "phantom"), Config().perception)
    except MissingExtra as missing:
        pytest.skip(str(missing))


def test_a_perceiver_is_deterministic_and_its_shaft_ends_beside_its_tip(perceiver, phantom_images):
    captures = phantom_images[1][::3]
    assert isinstance(perceiver, Perceiver)
    first = [perceiver(capture) for capture in captures]
    perceiver.reset()
    assert [perceiver(capture) for capture in captures] == first
    has_tips = any("needle_tip" in observation.found for observation in first)
    assert has_tips == ("needle_tip" in perceiver.entities)
    for capture, observation in zip(captures, first, strict=True):
        assert observation.stamp_ns == capture.stamp_ns
        if "needle_tip" in observation.found:
            tip, line = observation.found["needle_tip"], observation.found["needle_line"]
            assert isinstance(tip, Point) and isinstance(line, Segment)
            off_mm = np.array((*tip.at_mm, tip.z_mm)) - (*line.end_mm, line.end_z_mm)
            beside_mm = off_mm @ line.along_mm / np.linalg.norm(line.along_mm)
            assert abs(beside_mm) < 1e-4
            assert np.linalg.norm(off_mm) < WIDEST_MM


def test_a_perceiver_reports_only_the_entities_that_its_class_lists(perceiver, phantom_images, registration):
    _, captures = phantom_images
    assert isinstance(type(perceiver), PerceiverClass)
    assert perceiver.images in get_args(ImageKind)
    found = set().union(*(perceiver(capture).found for capture in captures[::10]))
    assert found - set(registration.anatomy) <= perceiver.entities
    assert found & perceiver.entities


def test_a_perceiver_does_not_read_the_truth(perceiver, phantom_images):
    _, captures = phantom_images
    some = captures[len(captures) // 2 :: 4]
    with_truth = [perceiver(capture) for capture in some]
    perceiver.reset()
    without = [Capture(c.index, c.stamp_ns, c.image) for c in some]
    assert [perceiver(capture) for capture in without] == with_truth


def test_a_perceiver_does_not_change_the_image(perceiver, phantom_images):
    _, captures = phantom_images
    image = captures[-10].image.copy()
    perceiver(captures[-10])
    assert np.array_equal(image, captures[-10].image)


def test_the_other_stages_fulfil_their_protocols_and_are_deterministic(procedure, registration):
    stages = (
        SchemaSceneBuilder(procedure.schema),
        RuleEngine(procedure),
        GrammarRenderer(procedure.patterns),
    )
    build, reason, render = stages
    assert isinstance(build, SceneBuilder)
    assert isinstance(reason, Reasoner)
    assert isinstance(render, Renderer)
    anatomy = registration.anatomy
    tips = [None, *(on_axis(anatomy, depth, 3.0) for depth in (-2, 5, 15, 20, 22.5))]

    def run():
        for stage in stages:
            stage.reset()
        return [render(reason(build(observe(anatomy, tip, n)))) for n, tip in enumerate(tips)]

    assert run() == run()


def test_a_sink_takes_steps_and_closes_twice():
    sink = ConsoleSink(io.StringIO())
    assert isinstance(sink, Sink)
    sink.write(Capture(0, 0, None), make_step(LOW))
    assert sink.dropped == 0
    assert sink.take_faults() == ()
    sink.close()
    sink.close()
