"""Every perceiver, device, sink and the other stages keep their contracts."""

import io

import numpy as np
import pytest
from helpers import LOW, make_step, observe, on_axis

from haptigraph import assemble
from haptigraph.config import Config
from haptigraph.errors import EndOfSource
from haptigraph.geometry import Point, Segment
from haptigraph.haptics.renderer import GrammarRenderer
from haptigraph.inference.engine import RuleEngine
from haptigraph.messages import Capabilities, Capture
from haptigraph.scene.builder import SchemaSceneBuilder
from haptigraph.sinks.console import ConsoleSink
from haptigraph.sources.phantom import PhantomSource
from haptigraph.stages import Device, Perceiver, Reasoner, Renderer, SceneBuilder, Sink


@pytest.fixture(scope="module")
def phantom_images(quick):
    source, captures = PhantomSource(quick), []
    try:
        while True:
            captures.append(source.read(1.0))
    except EndOfSource:
        return source.registration, captures


@pytest.fixture(params=assemble.PERCEIVERS)
def perceiver(request, phantom_images):
    registration, _ = phantom_images
    config = Config()
    from msgspec.structs import replace

    from haptigraph.perception.registration import parse_registration

    settings = replace(config.perception, perceiver=request.param)
    cls = assemble._named(assemble.PERCEIVERS, "perceiver", request.param)
    return cls(parse_registration(registration, "phantom"), settings)


def test_a_perceiver_never_guesses_and_repeats_itself(perceiver, phantom_images):
    _, captures = phantom_images
    assert isinstance(perceiver, Perceiver)
    first = [perceiver(capture) for capture in captures]
    perceiver.reset()
    assert [perceiver(capture) for capture in captures] == first
    for capture, observation in zip(captures, first, strict=True):
        assert observation.stamp_ns == capture.stamp_ns
        assert ("needle_tip" in observation.found) == ("needle_line" in observation.found)
        if "needle_tip" in observation.found:
            tip, line = observation.found["needle_tip"], observation.found["needle_line"]
            assert isinstance(tip, Point) and isinstance(line, Segment)
            assert line.end_mm == tip.at_mm


def test_a_perceiver_does_not_read_the_truth(perceiver, phantom_images):
    _, captures = phantom_images
    with_truth = [perceiver(capture) for capture in captures[30:60]]
    perceiver.reset()
    without = [Capture(c.index, c.stamp_ns, c.image) for c in captures[30:60]]
    assert [perceiver(capture) for capture in without] == with_truth


def test_a_perceiver_leaves_the_image_alone(perceiver, phantom_images):
    _, captures = phantom_images
    image = captures[60].image.copy()
    perceiver(captures[60])
    assert np.array_equal(image, captures[60].image)


@pytest.mark.parametrize("name", assemble.DEVICES)
def test_a_device_says_what_it_can_and_closes_twice(name, tmp_path):
    device = assemble.open_device(f"trace:{tmp_path / 'touch.csv'}" if name == "trace" else name)
    assert isinstance(device, Device)
    assert isinstance(device.capabilities, Capabilities)
    assert device.capabilities.amplitude_levels >= 1
    device.set(0.5, 80.0, 0)
    device.set(0.0, 0.0, 1)
    device.close()
    device.close()


def test_the_stages_between_fit_their_protocols_and_repeat_themselves(procedure, registration):
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
