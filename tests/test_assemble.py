import pytest

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.errors import BadInput


def refuse(*settings: str) -> str:
    with pytest.raises(BadInput) as refused:
        assemble.build(load_config(None, settings))
    return str(refused.value)


@pytest.mark.parametrize("registry", [assemble.PERCEIVERS, assemble.DEVICES, assemble.SOURCES])
def test_every_class_that_is_named_exists(registry):
    for path in registry.values():
        assert isinstance(assemble._load(path), type)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (("source.uri=nowhere.mp4",), "nowhere.mp4: no such source; valid: phantom:SCENARIO"),
        (("source.uri=phantom:nothing",), "unknown scenario 'nothing'"),
        (("source.uri=camera:first",), "camera:first is no camera; camera:0 is the first"),
        (("source.uri=camera:²",), "camera:² is no camera; camera:0 is the first"),
        ((f"source.uri=camera:{'9' * 5000}",), "is no camera; camera:0 is the first"),
        (("source.uri=video:",), "video:: no such source; valid: phantom:SCENARIO"),
        (('source.uri=""',), "'': no such source; valid: phantom:SCENARIO"),
        (("source.uri=camera:0", "run.realtime=false"), "camera:0 works in real time; --fast is for files"),
        (("haptics.device=serial:x", "run.realtime=false"), "serial:x works in real time; --fast is for"),
        (("source.uri=camera:0",), "camera:0 needs a registration; give --registration FILE"),
        (("haptics.device=glove",), "unknown device 'glove'; valid: audio, console, gamepad, ros2"),
        (("haptics.device=console:3",), "device 'console' takes nothing behind a colon"),
        (("perception.perceiver=magic",), "unknown perceiver 'magic'"),
        (
            ("run.procedure=magic",),
            "unknown procedure 'magic'; valid: membrane_peeling, subretinal_injection, ",
        ),
        (("trial.phase=injection",), "trial.phase: unknown phase 'injection'; valid: none"),
        (("source.registration=gone.toml",), "gone.toml: cannot be read"),
    ],
)
def test_what_cannot_be_assembled_is_one_sentence(settings, told):
    message = refuse(*settings)
    assert told in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("procedure", "asked", "perceiver"),
    [
        ("subretinal_injection", "auto", "tracker"),
        ("subretinal_injection_phases", "auto", "tracker"),
        ("membrane_peeling", "auto", "forceps"),
        ("membrane_peeling", "threshold", "threshold"),
    ],
)
def test_the_perceiver_is_the_one_that_sees_what_the_procedure_speaks_of(procedure, asked, perceiver):
    config = load_config(None, (f"perception.perceiver={asked}",))
    assert assemble.perceiver_name(config, assemble.load_procedure(procedure)) == perceiver


def test_a_video_without_registration_points_at_the_one_beside_it(clip):
    message = refuse(f"source.uri={clip / 'clip.mp4'}")
    assert "needs a registration; give --registration FILE; there is one beside it:" in message


def test_only_the_phantom_loops(clip):
    message = refuse(
        f"source.uri={clip / 'clip.mp4'}",
        f"source.registration={clip / 'registration.toml'}",
        "source.loop=true",
    )
    assert "source.loop works with phantom:SCENARIO only" in message


@pytest.mark.parametrize("fails", ["recording", "device", "perceiver"])
def test_nothing_is_left_behind_when_assembly_fails(quick_uri, tmp_path, fails):
    trace, record = tmp_path / "touch.csv", tmp_path / "run.mcap"
    settings = [f"source.uri={quick_uri}", f'haptics.device="trace:{trace}"', f'recording.path="{record}"']
    if fails == "perceiver":
        settings.append("perception.perceiver=magic")
    else:
        (record if fails == "recording" else trace).write_text("precious")
    refuse(*settings)
    left = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert left in ({}, {"run.mcap": "precious"}, {"touch.csv": "precious"})


def test_files_run_fast_and_the_phantom_in_real_time(quick_uri):
    from haptigraph.clock import MonotonicClock, VirtualClock

    live = assemble.build(load_config(None, (f"source.uri={quick_uri}",)))
    fast = assemble.build(load_config(None, (f"source.uri={quick_uri}", "run.realtime=false")))
    assert isinstance(live._clock, MonotonicClock)
    assert isinstance(fast._clock, VirtualClock)
    for loop in (live, fast):
        loop.close()


def test_what_a_device_cannot_is_noted(quick_uri, monkeypatch):
    from haptigraph.haptics.console import ConsoleDevice
    from haptigraph.messages import Capabilities

    monkeypatch.setattr(ConsoleDevice, "capabilities", Capabilities(1, None, 90.0))
    loop = assemble.build(load_config(None, (f"source.uri={quick_uri}", "run.realtime=false")))
    loop.close()
    assert "console: low: amplitude 0.3 becomes on or off" in loop.notes
    assert "console: pulse: 80 ms on, 80 ms off become 90 on, 80 off; no shorter ones are felt" in loop.notes


def test_an_interrupt_at_the_very_end_of_assembly_leaves_nothing_behind(quick_uri, tmp_path, monkeypatch):
    closed = []
    monkeypatch.setattr("haptigraph.sources.read_ahead.ReadAhead.close", lambda self: closed.append("source"))
    monkeypatch.setattr("haptigraph.haptics.guard.Guard.close", lambda self: closed.append("hand"))

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
    assert closed == ["hand", "source"]
    assert list(tmp_path.iterdir()) == []
