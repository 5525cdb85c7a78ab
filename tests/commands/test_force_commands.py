"""Commands that know force devices: the list, and the gentle test that starts only when it is asked for."""

import pytest
from helpers import call

from haptigraph.haptics.force import trial


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(trial, "LENGTH_NS", 500_000_000)


def test_force_devices_are_listed(ros_network):
    result = call("devices")
    assert result.exit_code == 0
    assert "Force devices\nsimulated" in result.output
    assert "haptigraph devices test FORCE" in result.output


@pytest.mark.parametrize("options", [(), ("--force",)])
def test_a_force_device_is_tried_gently(options):
    result = call("devices", "test", "simulated", *options)
    assert result.exit_code == 0
    assert "hold the handle" in result.output and "at most 1 N" in result.output
    assert "cycles missed" in result.output and "at most 0.00 N" in result.output


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        (("devices", "test", "crtk", "--force"), "force device crtk needs the arm's namespace"),
        (("devices", "test", "nothing", "--force"), "unknown force device 'nothing'"),
        (("run", "phantom:align_then_approach", "--fast", "--force", "simulated"), "works in real time"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(arguments, sentence):
    result = call(*arguments)
    assert result.exit_code == 2
    assert sentence in result.output
