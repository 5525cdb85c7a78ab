import sys
from types import ModuleType

import pytest

from haptigraph import assemble
from haptigraph.clock import MonotonicClock, VirtualClock
from haptigraph.config import load_config
from haptigraph.errors import BadInput, EndOfSource
from haptigraph.messages import Observation
from haptigraph.stages import Source


def error_of(*settings: str) -> str:
    with pytest.raises(BadInput) as raised:
        assemble.build(load_config(None, settings))
    return str(raised.value)


@pytest.mark.parametrize("registry", [assemble.PERCEIVERS, assemble.DEVICES, assemble.SOURCES])
def test_every_registered_class_exists(registry):
    for path in registry.values():
        assert isinstance(assemble._load(path), type)


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        (
            ("source.uri=nowhere.mp4",),
            "nowhere.mp4: file not found; `haptigraph sources` lists what SOURCE can be",
        ),
        (("source.uri=phantom:nothing",), "unknown scenario 'nothing'"),
        (
            ("source.uri=camera:first",),
            "camera:first is no camera number, device path or URL; the first camera is camera:0",
        ),
        (("source.uri=camera:²",), "camera:² is no camera number"),
        ((f"source.uri=camera:{'9' * 5000}",), "is no camera number, device path or URL; the first"),
        (("source.uri=video:",), "video:: no such source; valid: phantom[:SCENARIO]"),
        (('source.uri=""',), "'': no such source; valid: phantom[:SCENARIO]"),
        (("source.uri=camera:0", "run.realtime=false"), "camera:0 works in real time; --fast is for files"),
        (("haptics.device=serial:x", "run.realtime=false"), "serial:x works in real time; --fast is for"),
        (("source.uri=camera:0",), "camera:0 needs a registration; give --registration FILE"),
        (
            ("haptics.device=glove",),
            "unknown device 'glove'; valid: audio, console, crtk, drv2605, gamepad, ros2",
        ),
        (("haptics.device=console:3",), "device 'console' takes nothing behind a colon"),
        (("perception.perceiver=magic",), "unknown perceiver 'magic'"),
        (
            ("run.procedure=magic",),
            "unknown procedure 'magic'; valid: laser_photocoagulation, membrane_peeling, ",
        ),
        (("trial.phase=injection",), "trial.phase: unknown phase 'injection'; valid: none"),
        (("source.registration=gone.toml",), "gone.toml: cannot be read"),
    ],
)
def test_what_cannot_be_assembled_is_one_sentence(settings, problem):
    message = error_of(*settings)
    assert problem in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("procedure", "setting", "perceiver"),
    [
        ("subretinal_injection", "auto", "tracker"),
        ("subretinal_injection_phases", "auto", "tracker"),
        ("membrane_peeling", "auto", "forceps"),
        ("membrane_peeling", "threshold", "threshold"),
    ],
)
def test_auto_chooses_the_perceiver_that_finds_the_procedures_entities(procedure, setting, perceiver):
    config = load_config(None, (f"perception.perceiver={setting}",))
    assert assemble.perceiver_name(config, assemble.load_procedure(procedure)) == perceiver


def test_a_missing_registration_beside_a_video_is_suggested(clip):
    message = error_of(f"source.uri={clip / 'clip.mp4'}")
    assert "needs a registration; give --registration FILE; there is one beside it:" in message


def test_only_the_phantom_loops(clip):
    message = error_of(
        f"source.uri={clip / 'clip.mp4'}",
        f"source.registration={clip / 'registration.toml'}",
        "source.loop=true",
    )
    assert "source.loop works with phantom:SCENARIO only" in message


@pytest.mark.parametrize("fails", ["recording", "device", "perceiver"])
def test_a_failed_assembly_leaves_no_files(quick_uri, tmp_path, fails):
    trace, record = tmp_path / "touch.csv", tmp_path / "run.mcap"
    settings = [f"source.uri={quick_uri}", f'haptics.device="trace:{trace}"', f'recording.path="{record}"']
    if fails == "perceiver":
        settings.append("perception.perceiver=magic")
    else:
        (record if fails == "recording" else trace).write_text("precious")
    error_of(*settings)
    files = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert files in ({}, {"run.mcap": "precious"}, {"touch.csv": "precious"})


def test_files_run_fast_and_the_phantom_in_real_time(quick_uri):
    live = assemble.build(load_config(None, (f"source.uri={quick_uri}",)))
    fast = assemble.build(load_config(None, (f"source.uri={quick_uri}", "run.realtime=false")))
    assert isinstance(live._clock, MonotonicClock)
    assert isinstance(fast._clock, VirtualClock)
    for loop in (live, fast):
        loop.close()


def test_patterns_beyond_a_device_are_noted(quick_uri, monkeypatch):
    from haptigraph.haptics.console import ConsoleDevice
    from haptigraph.messages import Capabilities

    monkeypatch.setattr(ConsoleDevice, "capabilities", Capabilities(1, None, 90.0))
    loop = assemble.build(load_config(None, (f"source.uri={quick_uri}", "run.realtime=false")))
    loop.close()
    assert "console: low: amplitude 0.3 becomes on or off" in loop.notes
    assert "console: pulse: 80 ms on, 80 ms off become 90 on, 80 off; no shorter ones are felt" in loop.notes


def test_an_interrupt_at_the_end_of_assembly_closes_everything(quick_uri, tmp_path, monkeypatch):
    closed = []
    monkeypatch.setattr("haptigraph.sources.reading.ReadAhead.close", lambda self: closed.append("source"))
    monkeypatch.setattr("haptigraph.haptics.guard.Guard.close", lambda self: closed.append("output"))

    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(assemble, "Loop", interrupted)
    settings = (
        f"source.uri={quick_uri}",
        "run.realtime=false",
        f'haptics.device="trace:{tmp_path}/touch.csv"',
        f'recording.path="{tmp_path}/run.mcap"',
    )
    with pytest.raises(KeyboardInterrupt):
        assemble.build(load_config(None, settings))
    assert closed == ["output", "source"]
    assert list(tmp_path.iterdir()) == []


class MinimalSource:
    """A user's source without the optional members, which it does not inherit either."""

    rate_hz, is_live, registration = 30.0, False, None

    def __init__(self, argument):
        pass

    def read(self, timeout_s):
        raise EndOfSource

    def close(self):
        pass


class InheritingSource(MinimalSource, Source):
    pass


class MinimalPerceiver:
    def __init__(self, registration, config):
        pass

    def __call__(self, capture):
        return Observation(capture.stamp_ns)

    def reset(self):
        pass


@pytest.fixture
def my_lab(monkeypatch):
    module = ModuleType("my_lab")
    for part in (MinimalSource, InheritingSource, MinimalPerceiver):
        setattr(module, part.__name__, part)
    monkeypatch.setitem(sys.modules, "my_lab", module)
    monkeypatch.setitem(assemble.SOURCES, "minimal", "my_lab:MinimalSource")
    monkeypatch.setitem(assemble.SOURCES, "inheriting", "my_lab:InheritingSource")


def test_a_source_of_a_user_must_have_every_member(my_lab):
    assert error_of("source.uri=minimal:x") == (
        "source minimal (my_lab:MinimalSource) lacks depth_camera, notes, robot_setup, teleop; define what haptigraph.stages.Source lists"
    )


def test_a_source_of_a_user_inherits_the_optional_members(my_lab):
    source = assemble.open_source(load_config(None, ("source.uri=inheriting:x",)), VirtualClock())
    assert (source.notes, source.teleop, source.registration) == ((), None, None)


def test_a_margin_is_refused_if_the_perceiver_estimates_no_standard_deviation(quick_uri):
    settings = f"source.uri={quick_uri}", "run.procedure=subretinal_injection_cautious"
    assert error_of(*settings, "perception.perceiver=threshold") == (
        "subretinal_injection_cautious has margin_sd, but perceiver threshold estimates no standard deviation "
        "of needle_tip; choose another of either"
    )
    assemble.build(load_config(None, settings)).close()


def test_a_perceiver_of_a_user_must_have_every_member(my_lab, quick_uri, monkeypatch):
    monkeypatch.setitem(assemble.PERCEIVERS, "minimal", "my_lab:MinimalPerceiver")
    for setting in ("minimal", "auto"):
        assert error_of(f"source.uri={quick_uri}", f"perception.perceiver={setting}") == (
            "perceiver minimal (my_lab:MinimalPerceiver) lacks entities, entities_with_sd, images; "
            "define what haptigraph.stages.PerceiverClass lists"
        )
