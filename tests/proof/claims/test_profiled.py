"""Claims about a haptic grammar on a device with a profile."""

from types import SimpleNamespace

import pytest
from made_profiles import TEXT
from msgspec.structs import replace

from haptigraph.assemble import load_procedure
from haptigraph.haptics.gamepad import GamepadDevice
from haptigraph.haptics.profiles.profile import DeviceProfile, Point, parse_profile
from haptigraph.messages import Capabilities, Pattern
from haptigraph.proof.claims.profiled import profile_claims
from haptigraph.proof.prove import prove

PAD = GamepadDevice.capabilities
GOOD = ((0.15, 0.05, 0.01), (0.5, 0.4, 0.02), (1.0, 1.0, 0.02))


def profile_of(*points: tuple[float, float, float], frequency_hz: float | None = None) -> DeviceProfile:
    profile = parse_profile(TEXT, "p.toml")
    points_ = tuple(Point(*each) for each in points)
    return replace(profile, intensity=replace(profile.intensity, point=points_, frequency_hz=frequency_hz))


def violated(profile: DeviceProfile, device: Capabilities = PAD) -> dict[str, list[str]]:
    """The violated claims of the device, each with its sentences."""
    proof = prove(load_procedure("subretinal_injection"), "auto", ("gamepad", device), None, profile)
    assert [claim.name for claim in proof.claims if claim.name.startswith("profile")] == [
        "profile",
        "profile distinct",
    ]
    return {
        claim.name: [violation.sentence for violation in claim.violations]
        for claim in proof.claims
        if claim.name.startswith(("device", "profile")) and not claim.holds
    }


def test_a_device_that_gives_every_pattern_as_meant_violates_nothing():
    assert violated(profile_of(*GOOD)) == {}


def test_a_weak_device_cannot_give_the_alarm_as_strong_as_meant():
    found = violated(profile_of((0.15, 0.05, 0.01), (1.0, 0.6, 0.02)))
    assert (
        found["profile"][0] == "pulse: amplitude 1 is felt as 0.6, the strongest that is known of the device"
    )


def test_an_alarm_that_is_hardly_stronger_than_guidance_on_a_device_is_found():
    found = violated(profile_of((0.15, 0.05, 0.01), (1.0, 0.35, 0.02)))
    assert any("feels 'pulse' of amplitude 0.35" in sentence for sentence in found["device alarm"])


def test_what_is_known_too_badly_may_feel_alike():

    low, high = (Pattern(name, "continuous", each, 0.0) for name, each in (("low", 0.3), ("high", 0.8)))
    procedure = SimpleNamespace(patterns=(low, high))
    known, vague = profile_of(*GOOD), profile_of(*((d, i, 0.2) for d, i, _ in GOOD))
    assert profile_claims(procedure, "pad", PAD, known)[1].holds
    (violation,) = profile_claims(procedure, "pad", PAD, vague)[1].violations
    assert violation.sentence == "'low' and 'high' differ as written, but may feel alike on this device"


def test_what_is_near_the_threshold_may_not_be_felt():
    profile = profile_of(*GOOD)
    deaf = replace(profile, threshold=replace(profile.threshold, high=0.45))
    assert "low: amplitude 0.3 may not be felt: its drive is 0.42" in violated(deaf)["profile"][0]


def test_a_slow_actuator_shifts_the_rhythm():
    profile = profile_of(*GOOD)
    slow = replace(profile, onset=replace(profile.onset, shortest_on_ms=130.0, high_ms=140.0))
    assert any("80 ms on, 80 ms off become 130 on" in sentence for sentence in violated(slow)["device"])


def test_frequencies_that_were_not_measured_are_listed_as_not_covered():
    coil = Capabilities(32767, (20.0, 1000.0), 10.0)
    procedure = load_procedure("subretinal_injection")
    for hz, is_listed in ((160.0, True), (None, False)):
        proof = prove(procedure, "auto", ("audio", coil), None, profile_of(*GOOD, frequency_hz=hz))
        listed = [each for each in proof.uncovered if each.startswith("how strong low (80 Hz)")]
        assert bool(listed) == is_listed


@pytest.mark.parametrize("given", [None, PAD])
def test_without_a_profile_nothing_is_claimed_of_it(given):
    device = ("gamepad", given) if given else None
    proof = prove(load_procedure("subretinal_injection"), "auto", device)
    assert not any(claim.name.startswith("profile") for claim in proof.claims)
