"""A sham: the grammar's patterns at times that depend on a seed alone, silent when the state is unknown."""

from contextlib import closing

import pytest
from helpers import LOW, MS, PULSE, SUCCESS
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.analysis.metrics.replay import replay
from haptigraph.analysis.metrics.trial import measure_recording
from haptigraph.assemble import build, build_pipeline, load_procedure
from haptigraph.config import Config, HapticsConfig, load_config
from haptigraph.haptics.sham import ShamRenderer
from haptigraph.messages import OFF, UNKNOWN, Conclusion
from haptigraph.recording.reader import RunReader

PATTERNS = (OFF, LOW, PULSE, SUCCESS)


def played(states, seed=3, duty=0.5, patterns=PATTERNS):
    """Return the pattern in each of a row of states, one every 33 ms."""
    render = ShamRenderer(patterns, seed, duty)
    return [
        render(Conclusion(number * 33 * MS, state, 0, "off", "")).pattern
        for number, state in enumerate(states)
    ]


@given(st.lists(st.sampled_from(["hit", "contact", "aligned", UNKNOWN]), min_size=1, max_size=400))
def test_a_sham_depends_on_no_state_except_that_unknown_is_silent(states):
    always = played(["aligned"] * len(states))
    for state, pattern, reference in zip(states, played(states), always, strict=True):
        assert pattern == (OFF if state == UNKNOWN else reference)


@pytest.mark.parametrize("duty", [0.1, 0.5, 0.9])
def test_a_sham_vibrates_for_its_share_of_the_time_with_every_pattern_that_lasts(duty):
    patterns = played(["aligned"] * 60_000, duty=duty)  # 33 minutes, about 1400 segments
    share = sum(pattern != OFF for pattern in patterns) / len(patterns)
    assert abs(share - duty) < 0.05
    assert {pattern.name for pattern in patterns} == {"off", "low", "pulse"}


def test_a_seed_is_a_schedule_and_reset_starts_it_again():
    states = ["aligned"] * 500
    assert played(states) == played(states) != played(states, seed=4)
    render = ShamRenderer(PATTERNS, 3, 0.5)
    first = [render(Conclusion(n * 33 * MS, "aligned", 0, "off", "")) for n in range(100)]
    render.reset()
    assert [render(Conclusion(n * 33 * MS, "aligned", 0, "off", "")) for n in range(100)] == first
    assert played(states, patterns=(OFF, SUCCESS)) == [OFF] * 500


def test_a_configured_sham_replaces_the_grammar(registration):
    procedure = load_procedure("subretinal_injection")
    config = Config(haptics=HapticsConfig(sham_seed=1, weakest_amplitude=0.5)).with_perceiver("tracker")
    pipeline = build_pipeline(config, registration, procedure)
    commands = {
        pipeline.render(Conclusion(number * 33 * MS, "aligned", 0, "off", "")).pattern
        for number in range(900)
    }
    assert {(pattern.name, pattern.amplitude) for pattern in commands} == {
        ("off", 0.0),
        ("low", 0.5),
        ("pulse", 1.0),
    }


def test_a_run_declares_a_sham(quick_uri):
    config = load_config(None, (f"source.uri={quick_uri}", "run.realtime=false", "haptics.sham_seed=1"))
    with closing(build(config)) as loop:
        assert "the vibration is a sham: it comes at random times and warns of nothing" in loop.notes


def test_a_recorded_sham_replays_the_same(quick_uri, tmp_path):
    path = tmp_path / "sham.mcap"
    settings = ("run.realtime=false", "haptics.sham_seed=1", "haptics.weakest_amplitude=0.5")
    build(load_config(None, (f"source.uri={quick_uri}", f"recording.path={path}", *settings))).run()
    report = replay(path)
    assert report.identical == report.steps > 0
    steps = [step for _, step in RunReader(path).records(images=())]
    assert {step.command.pattern.amplitude for step in steps} == {0.0, 0.5, 1.0}
    assert measure_recording(path)["touch"] == "sham"
