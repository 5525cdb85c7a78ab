"""Replace what identifies a person or a moment: random names, times without dates, texts without contacts."""

import re
import secrets
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from string import ascii_uppercase
from typing import Any

__all__ = ["ORIGIN", "new_names", "shifted", "without_contacts"]

ORIGIN = datetime(2000, 1, 1, tzinfo=UTC)
"""When every participant enrolled, in what is published; only durations are real."""
CONTACT = re.compile(r"[\w.+-]+@[\w-]+(?:\.[\w-]+)+|\+\d[\d ()/-]{6,}\d")
CONTACT_LEFT_OUT = "(contact left out)"


def new_names(pseudonyms: Collection[str]) -> dict[str, str]:
    """Return a random name for each pseudonym, different in each call; no new name contains an old one."""
    names: dict[str, str] = {}
    for pseudonym in pseudonyms:
        name = _random_name()
        while name in names.values() or any(old in name for old in pseudonyms if len(old) > 2):
            name = _random_name()
        names[pseudonym] = name
    return names


def _random_name() -> str:
    letters = "".join(secrets.choice(ascii_uppercase) for _ in range(4))
    return f"{letters}{secrets.randbelow(10_000):04}"


def shifted(stamp_utc: str, person: Mapping[str, Any]) -> str:
    """Return a time stamp of a participant as if they had enrolled at `ORIGIN`."""
    since_enrolment = datetime.fromisoformat(stamp_utc) - datetime.fromisoformat(person["enrolled_utc"])
    return (ORIGIN + since_enrolment).isoformat(timespec="microseconds")


def without_contacts(text: str) -> tuple[str, int]:
    """Replace e-mail addresses and international telephone numbers; return the text and their number."""
    return CONTACT.subn(CONTACT_LEFT_OUT, text)
