"""Claims about touch: broken haptic grammars violate one, sensible ones none."""

import re

import pytest
from msgspec.structs import replace

from haptigraph.assemble import load_procedure, parse_procedure, procedure_names
from haptigraph.haptics.console import ConsoleDevice
from haptigraph.haptics.gamepad import GamepadDevice
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Capabilities
from haptigraph.proof.claims.haptic import device_claims, haptic_claims

BASE = "subretinal_injection_continuous"


def changed(pattern: str, name: str = BASE, **numbers: object) -> Procedure:
    """A shipped procedure with other numbers in one pattern."""
    head, mark, tail = load_procedure(name).text.partition(f'[[pattern]]\nname = "{pattern}"')
    body, end, rest = tail.partition("[[")
    for key, value in numbers.items():
        body, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", body)
        if not count:
            body += f"{key} = {value}\n"
    return parse_procedure(head + mark + body + end + rest, "changed.toml")


def replaced(old: str, new: str, name: str = BASE) -> Procedure:
    text = load_procedure(name).text
    assert old in text
    return parse_procedure(text.replace(old, new, 1), "changed.toml")


def violated(procedure: Procedure) -> dict[str, list[str]]:
    """The violated claims, each with its sentences."""
    return {
        claim.name: [violation.sentence for violation in claim.violations]
        for claim in haptic_claims(procedure)
        if not claim.holds
    }


@pytest.mark.parametrize("name", procedure_names())
def test_every_shipped_grammar_holds(name):
    assert not violated(load_procedure(name))


@pytest.mark.parametrize(
    ("pattern", "numbers", "claim", "sentence"),
    [
        ("pulse", {"amplitude": 0.001}, "felt", "amplitude 0.001, which is not felt"),
        ("pulse", {"amplitude": 0.001}, "alarm felt", "an alarm has at least 0.2"),
        ("pulse", {"amplitude": 0.1}, "alarm strongest", "feels 'pulse' of amplitude 0.1"),
        ("lean", {"amplitude": 0.9}, "alarm strongest", "weaken 'lean'"),
        ("success", {"amplitude": 1.0, "on_ms": 80, "off_ms": 80}, "alarm unlike", "cannot be distinguished"),
        ("pulse", {"off_ms": 3_600_000}, "alarm felt", "pauses for 3.6e+06 ms"),
        ("pulse", {"off_ms": 800}, "alarm felt", "pauses for 800 ms; an alarm pauses for at most 500 ms"),
        ("pulse", {"frequency_hz": 5000}, "felt", "5000 Hz, which skin does not feel"),
        ("pulse", {"frequency_hz": 2.8}, "felt", "2.8 Hz, which skin does not feel"),
        ("pulse", {"on_ms": 1}, "felt", "bursts of 1 ms, which are not felt"),
        ("pulse", {"on_ms": 40}, "alarm felt", "bursts of 40 ms; those of an alarm last at least 50 ms"),
        ("pulse", {"off_ms": 8}, "felt", "pauses of 8 ms, which are not felt, so it has no rhythm"),
        ("success", {"on_ms": 20, "frequency_hz": 80}, "felt", "1.6 cycles of 80 Hz"),
        ("success", {"amplitude": 0.01}, "felt", "amplitude 0.01"),
        ("success", {"count": 20}, "felt", "goes on for 3900 ms after its state is entered"),
        ("success", {"off_ms": 600}, "felt", "pauses for 600 ms, so it is felt as separate events"),
        ("near", {"off_ms": 2800}, "felt", "pauses for 2800 ms, so it is felt as separate events"),
        ("pulse", {"on_ms": 900, "off_ms": 200}, "alarm felt", "repeats every 1100 ms"),
        ("lean", {"frequency_hz": 800}, "felt", "800 Hz"),
        ("success", {"amplitude": 0.08}, "felt", "amplitude 0.08"),
        ("lean", {"frequency_hz": 8}, "felt", "8 Hz"),
    ],
)
def test_a_broken_number_violates_its_claim(pattern, numbers, claim, sentence):
    assert any(sentence in found for found in violated(changed(pattern, **numbers))[claim])


def test_the_number_that_follows_a_measure_counts_as_well():
    procedure = replaced("end = [10.0, 0.6]", "end = [10.0, 0.95]")
    assert "feels 'lean' of 0.95; weaken 'lean'" in violated(procedure)["alarm strongest"][0]
    assert "0.01" in violated(replaced("start = [1.7, 0.15]", "start = [1.7, 0.01]"))["felt"][0]


def test_an_alarm_that_feels_what_guidance_feels_is_found():
    procedure = replaced('feel = "pulse"', 'feel = "lean"')
    assert "feel the same pattern, 'lean'" in violated(procedure)["alarm unlike"][0]


def test_an_alarm_like_guidance_that_follows_a_measure_is_found_at_the_value_where_they_meet():
    alike = changed("near", on_ms=80, frequency_hz=160)
    assert not violated(alike)  # at most 4 pulses a second
    alike = parse_procedure(alike.text.replace("end = [0.7, 4.0]", "end = [0.7, 6.0]"), "alike.toml")
    alike = parse_procedure(alike.text.replace("end = [10.0, 0.6]", "end = [10.0, 0.7]"), "alike.toml")
    assert "'pulse' and 'near', which cannot be distinguished" in violated(alike)["alarm unlike"][0]


def test_bursts_and_silence_are_no_alarm():
    once = replaced('feel = "pulse"', 'feel = "success"')
    assert "'success', which plays once" in violated(once)["alarm felt"][0]
    silent = replaced('feel = "pulse"', 'feel = "off"')
    assert "'off', which is silence" in violated(silent)["alarm felt"][0]


def test_two_alarms_may_feel_the_same():
    procedure = load_procedure("subretinal_injection_phases")
    alarms = [state for state in procedure.states if procedure.kinds[state.name] == "alarm"]
    assert len({state.feel for state in alarms}) == 1 < len(alarms)
    assert not violated(procedure)


def test_without_an_alarm_the_claims_say_so():
    procedure = replaced('kind = "alarm"', 'kind = "guidance"')
    statements = [claim.statement for claim in haptic_claims(procedure) if claim.name.startswith("alarm")]
    assert len(statements) == 3
    assert all("(no state is an alarm)" in statement for statement in statements)


@pytest.mark.parametrize(
    ("pattern", "numbers"),
    [
        ("pulse", {"amplitude": 0.85}),
        ("pulse", {"on_ms": 60, "off_ms": 60}),
        ("pulse", {"on_ms": 100, "off_ms": 50}),
        ("pulse", {"frequency_hz": 250}),
        ("success", {"amplitude": 0.6}),
        ("success", {"count": 3}),
        ("success", {"count": 1, "on_ms": 300}),
        ("lean", {"frequency_hz": 60}),
        ("near", {"on_ms": 100, "off_ms": 300}),
        ("pulse", {"kind": '"continuous"', "on_ms": 0, "off_ms": 0, "frequency_hz": 250}),
    ],
)
def test_sensible_variants_hold(pattern, numbers):
    assert not violated(changed(pattern, **numbers))


def test_a_device_that_can_play_everything_violates_nothing(procedure):
    assert all(claim.holds for claim in device_claims(procedure, "console", ConsoleDevice.capabilities))


def test_what_is_beyond_a_device_is_found(procedure):
    patterns = tuple(replace(one, on_ms=30) if one.name == "success" else one for one in procedure.patterns)
    can_play, alarm = device_claims(replace(procedure, patterns=patterns), "pad", GamepadDevice.capabilities)
    (violation,) = can_play.violations
    assert violation.sentence.startswith("success: 30 ms on, 100 ms off become 50 on")
    assert alarm.holds
    assert all(claim.holds for claim in device_claims(procedure, "gamepad", GamepadDevice.capabilities))


def test_a_device_on_which_the_alarm_is_no_stronger_is_found(procedure):
    on_or_off = Capabilities(amplitude_levels=1, frequency_range_hz=None, shortest_on_ms=200.0)
    _, alarm = device_claims(procedure, "buzzer", on_or_off)
    sentences = [violation.sentence for violation in alarm.violations]
    assert any("feels 'low' of 1; weaken 'low'" in sentence for sentence in sentences)
    assert any("'pulse' and 'success', which cannot be distinguished" in sentence for sentence in sentences)
