"""Which outputs a station has, and its test pulse."""

from contextlib import closing

import pytest
from msgspec.structs import replace
from studying import PROTOCOL, study_at

from haptigraph import run_device
from haptigraph.clock import VirtualClock
from haptigraph.config import HapticsConfig
from haptigraph.dashboard.server.viewer import Viewer
from haptigraph.dashboard.study import touch_output
from haptigraph.dashboard.study.touch_output import TouchOutput
from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.console import ConsoleDevice
from haptigraph.study.runner import open_session
from haptigraph.study.store import Store


class Actuator(ConsoleDevice):
    """A sound card in tests; `is_lost` makes it fail once something vibrates."""

    is_there, is_lost = True, False

    def __init__(self, argument=""):
        if not self.is_there:
            raise BadInput("is not connected", "audio")
        super().__init__()

    def set(self, amplitude, frequency_hz, stamp_ns):
        if amplitude and self.is_lost:
            raise DeviceError("no longer answers")


@pytest.fixture
def actuator(monkeypatch):
    class Card(Actuator):
        pass

    monkeypatch.setattr(run_device, "device_class", lambda kind: Card)
    return Card


@pytest.fixture
def session(tmp_path):
    (tmp_path / "study.toml").write_text(PROTOCOL)
    with closing(Store(tmp_path / "study.db")) as store:
        study = study_at(tmp_path, store)
        yield open_session(study, study.enrol(), "lab 1")


def touch_of(*outputs, device="console", **limits):
    viewers, levels, alive_ns = [Viewer(f"page {n}") for n, _ in enumerate(outputs)], [], []
    for viewer, output in zip(viewers, outputs, strict=True):
        viewer.outputs = output
    config = HapticsConfig(device=device, **limits)
    touch = TouchOutput(
        config, viewers, lambda stamp_ns, amplitude, hz: levels.append((stamp_ns, amplitude)), alive_ns.append
    )
    return touch, levels, alive_ns


@pytest.mark.parametrize(
    ("device", "pages", "name"),
    [
        ("console", (), ""),
        ("console", ((), ()), ""),
        ("trace:x.csv", (), ""),
        ("audio:x.wav", (), ""),
        ("audio", (), "audio"),
        ("serial:ttyACM0", (("screen",),), "serial:ttyACM0 + screen"),
        ("console", (("screen", "sound"), ("screen",)), "screen + sound"),
    ],
)
def test_the_outputs_are_the_actuator_and_those_of_the_pages(device, pages, name):
    assert touch_of(*pages, device=device)[0].name == name


def test_with_an_amplitude_limit_of_0_nothing_can_be_felt():
    assert touch_of(("screen",), device="audio", max_amplitude=0.0)[0].name == ""


def trials_of(session, blind):
    """Return a trial with touch and one without, under a protocol that is blind to somebody."""
    protocol = session.study.protocol
    protocol = replace(protocol, study=replace(protocol.study, blind=blind))
    session.study = replace(session.study, protocol=protocol)
    return [stage for stage in session.plan if stage.kind == "trial"]


@pytest.mark.parametrize(("blind", "without"), [("nobody", False), ("participant", True), ("everyone", True)])
def test_a_trial_without_touch_needs_no_output_unless_that_would_reveal_its_condition(
    session, blind, without
):
    touch, *_ = touch_of()
    felt, seen = trials_of(session, blind)
    assert "there is no haptic output" in touch.problem(session, felt)
    assert ("there is no haptic output" in touch.problem(session, seen)) is without
    assert touch.problem(session, session.plan[0]) == ""  # the briefing


def test_the_pulse_is_within_the_limits_and_its_answer_lasts_for_the_session_and_the_outputs(
    session, actuator, monkeypatch
):
    monkeypatch.setattr(touch_output, "MonotonicClock", VirtualClock)
    touch, levels, alive_ns = touch_of(("screen",), device="audio", max_amplitude=0.3)
    trial = trials_of(session, "nobody")[0]
    with pytest.raises(BadInput, match="press Test pulse first"):
        touch.answer(session, is_felt=True)
    assert levels == []  # nothing vibrates by itself
    touch.play(session)
    played = [amplitude for _, amplitude in levels]
    assert max(played) == 0.3 and played[-1] == 0.0
    for start_ns, amplitude in levels:  # a page plays nothing that was not kept alive just before
        assert not amplitude or any(0 <= start_ns - each_ns <= 100e6 for each_ns in alive_ns)
    assert "is not confirmed" in touch.problem(session, trial)
    touch.answer(session, is_felt=True)
    assert touch.problem(session, trial) == ""
    with pytest.raises(BadInput, match="press Test pulse first"):
        touch.answer(session, is_felt=True)
    touch._viewers[0].outputs = ()
    assert "has changed since the last test pulse" in touch.problem(session, trial)
    touch._viewers[0].outputs = ("screen",)
    assert touch.problem(session, trial) == ""
    again = open_session(session.study, "P01", "lab 1")
    assert "is not confirmed" in touch.problem(again, trial)


def test_a_device_that_is_not_there_or_fails_is_named_and_confirms_nothing(session, actuator):
    touch, *_ = touch_of(device="audio")
    actuator.is_lost = True
    with pytest.raises(DeviceError, match="audio: no longer answers"):
        touch.play(session)
    actuator.is_there = False
    with pytest.raises(BadInput, match="audio: is not connected"):
        touch.play(session)
    with pytest.raises(BadInput, match="press Test pulse first"):
        touch.answer(session, is_felt=True)
