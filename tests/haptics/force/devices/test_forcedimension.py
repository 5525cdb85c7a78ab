"""A Force Dimension device through a stand-in for its binding; no hardware was ever tried."""

import inspect
import json
import os
import subprocess
import sys
from importlib.util import find_spec

import pytest
from force_dimension import Dhd, installed

from haptigraph.clock import MonotonicClock
from haptigraph.errors import BadInput, DeviceError, MissingExtra
from haptigraph.haptics.force.devices.forcedimension import ForceDimension

ZERO = (0.0, 0.0, 0.0)
NEEDS_BINDING = pytest.mark.skipif(
    find_spec("forcedimension_core") is None, reason="needs pip install 'haptigraph[forcedimension]'"
)


@pytest.fixture
def dhd():
    with installed() as dhd:
        yield dhd


@pytest.fixture
def device(dhd):
    return ForceDimension("", MonotonicClock())


def test_it_opens_with_a_force_of_zero_its_own_limit_and_watchdog(device, dhd):
    assert dhd.calls == [
        ("openID", 0),
        ("setForce", *ZERO),
        ("enableExpertMode",),
        ("setWatchdog", 160),  # of 125 us
        ("disableExpertMode",),
        ("setMaxForce", 3.0),
    ]
    assert device.capabilities.holds_ms == 20.0


def test_a_controller_without_watchdog_is_used_and_says_so(dhd):
    dhd.fails = ("setWatchdog",)
    assert ForceDimension("0", MonotonicClock()).capabilities.holds_ms is None
    assert ("disableExpertMode",) in dhd.calls


def test_position_velocity_and_force_have_our_axes(device, dhd):
    dhd.position_m, dhd.velocity_m_s = (0.003, 0.001, 0.002), (0.03, 0.01, 0.02)
    reading = device.exchange((1.0, 2.0, 3.0))
    assert reading.position_mm == pytest.approx((1.0, 2.0, 3.0))
    assert reading.velocity_mm_s == pytest.approx((10.0, 20.0, 30.0))
    assert ("setForce", 3.0, 1.0, 2.0) in dhd.calls


def test_the_button_is_the_clutch(device, dhd):
    assert not device.exchange(ZERO).engaged
    dhd.button = 1
    assert device.exchange(ZERO).engaged


@pytest.mark.parametrize("name", ["setForce", "getPosition", "getLinearVelocity", "getButton"])
def test_an_error_of_the_sdk_is_an_error_of_the_device(device, dhd, name):
    dhd.fails = (name,)
    with pytest.raises(DeviceError, match="device timed out"):
        device.exchange(ZERO)


def test_it_lets_go_brakes_and_closes_once(device, dhd):
    device.exchange((1.0, 0.0, 0.0))
    dhd.calls.clear()
    device.close()
    device.close()
    assert dhd.calls == [("setForce", *ZERO), ("stop",), ("close",)]


@pytest.mark.parametrize("name", ["setForce", "stop"])
def test_a_release_that_fails_is_not_claimed(device, dhd, name):
    dhd.fails = (name,)
    with pytest.raises(DeviceError):
        device.close()
    assert dhd.calls[-1] == ("close",)


@pytest.mark.parametrize(
    "argument, sentence",
    [("one", "expected the device's number"), ("3", "forcedimension:3: it cannot be opened")],
)
def test_a_device_that_is_not_there_is_refused(dhd, argument, sentence):
    with pytest.raises(BadInput, match=sentence):
        ForceDimension(argument, MonotonicClock())


def test_connected_devices_are_found(dhd):
    dhd.count = 2
    assert list(ForceDimension.found()) == ["forcedimension:0", "forcedimension:1"]


@pytest.mark.skipif(find_spec("forcedimension_core") is not None, reason="the binding is installed")
def test_without_the_binding_the_error_names_the_extra():
    with pytest.raises(MissingExtra, match=r"haptigraph\[forcedimension\]"):
        ForceDimension("", MonotonicClock())


def test_without_the_sdk_the_error_says_so(tmp_path, monkeypatch):
    package = tmp_path / "forcedimension_core" / "dhd"
    package.mkdir(parents=True)
    (package.parent / "__init__.py").write_text("")
    (package / "__init__.py").write_text("raise ImportError('There were problems loading libdrd.')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(BadInput, match="the Force Dimension SDK"):
        ForceDimension("", MonotonicClock())
    for name in [name for name in sys.modules if name.startswith("forcedimension_core")]:
        monkeypatch.delitem(sys.modules, name)


@NEEDS_BINDING
def test_the_stand_in_has_the_signatures_of_the_binding():
    program = (
        "import inspect, json, forcedimension_core.dhd as dhd\n"
        "names = {name: list(inspect.signature(getattr(m, name)).parameters) for m in (dhd, dhd.expert)"
        " for name in dir(m) if inspect.isfunction(getattr(m, name))}\n"
        "print(json.dumps(names))"
    )
    environment = {**os.environ, "__fdsdkpy_unittest__": "True", "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    binding = json.loads(done.stdout)
    for part in (Dhd, Dhd.Expert):
        for name, function in inspect.getmembers(part, inspect.isfunction):
            if name not in ("__init__", "did"):
                assert list(inspect.signature(function).parameters)[1:] == binding[name], name
