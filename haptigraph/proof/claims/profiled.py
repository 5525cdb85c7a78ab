"""Claims about a haptic grammar on a device with a profile: felt, as strong as meant, and distinct."""

from collections.abc import Iterator
from itertools import combinations

from msgspec.structs import replace

from haptigraph.haptics.profiles.fit import misfits
from haptigraph.haptics.profiles.profile import DeviceProfile
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Capabilities, Pattern
from haptigraph.proof.claims.felt import Band, Felt, are_alike, felt
from haptigraph.proof.report import Claim, Violation

__all__ = ["profile_claims"]

Z_975 = 1.96


def profile_claims(
    procedure: Procedure, name: str, device: Capabilities, profile: DeviceProfile
) -> list[Claim]:
    """Return the claims about a haptic grammar that need the profile of the device.

    Args:
        procedure: A checked procedure.
        name: The device's name.
        device: Its capabilities, with what was measured of it.
        profile: Its profile.
    """
    patterns = procedure.patterns
    return [
        Claim(
            "profile",
            f"{name} gives every pattern as strong as meant, and above its threshold, by its profile",
            tuple(
                Violation(sentence, f"pattern {pattern.name}")
                for pattern in patterns
                for sentence in misfits(pattern, profile)
            ),
        ),
        Claim(
            "profile distinct",
            f"patterns that differ as written can be distinguished on {name}, within the uncertainty of its "
            "profile",
            tuple(_merged(patterns, device, profile)),
        ),
    ]


def _merged(
    patterns: tuple[Pattern, ...], device: Capabilities, profile: DeviceProfile
) -> Iterator[Violation]:
    for one, other in combinations([each for each in patterns if each.kind != "off"], 2):
        played = [_uncertain(felt(each, device, profile), profile) for each in (one, other)]
        if not are_alike(felt(one), felt(other)) and are_alike(*played):
            sentence = f"{one.name!r} and {other.name!r} differ as written, but may feel alike on this device"
            yield Violation(sentence, f"pattern {other.name}")


def _uncertain(felt_: Felt, profile: DeviceProfile) -> Felt:
    """Return what is felt, with the interval of 95 % of its intensity."""
    low, high = felt_.amplitude
    low, high = low - Z_975 * profile.sd_at(low), high + Z_975 * profile.sd_at(high)
    return replace(felt_, amplitude=Band(max(low, 0.0), min(high, 1.0)))
