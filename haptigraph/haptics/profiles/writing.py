"""Turn a profile into the text of its file, with numbers as precise as they are."""

import json

from msgspec import Struct
from msgspec.structs import asdict

from haptigraph.haptics.profiles.profile import DeviceProfile, parse_profile

__all__ = ["profile_text"]

HEAD = """\
# How strong a device feels, for --profile. Documentation of all keys: "Measure how strong a device feels".
# basis: "measured" by a clock or an instrument, "answers" of a person, "literature", "judgement".
"""


def profile_text(profile: DeviceProfile) -> str:
    """Return the text of a profile.

    Raises:
        BadInput: If it is not valid.
    """
    tables = {
        "device": profile.device,
        "provenance": profile.provenance,
        "threshold": profile.threshold,
        "onset": profile.onset,
        "latency": profile.latency,
        "intensity": profile.intensity,
    }
    parts = [f"{HEAD}format = {profile.format}"]
    parts += [_table(name, table) for name, table in tables.items() if table is not None]
    parts += [_table("[intensity.point]", point) for point in profile.intensity.point]
    text = "\n\n".join(parts) + "\n"
    parse_profile(text, "the profile")
    return text


def _table(name: str, table: Struct) -> str:
    """Return a TOML table of the plain values of a struct."""
    values = {key: value for key, value in asdict(table).items() if value is not None}
    lines = [f"{key} = {_text(value)}" for key, value in values.items() if not isinstance(value, tuple)]
    return "\n".join([f"[{name}]", *lines])


def _text(value: object) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return f"{value:.4g}" if isinstance(value, float) else str(value)
