"""A valid profile as text, and any valid profile."""

from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.haptics.profiles.profile import Point, parse_profile

TEXT = """format = 1
[device]
uri = "gamepad:0"
description = "a pad"
[provenance]
by = "P01"
date = 2026-11-26
how = "by hand"
[threshold]
basis = "answers"
source = "40 stimuli"
drive = 0.1
low = 0.08
high = 0.12
[onset]
basis = "measured"
source = "accelerometer"
shortest_on_ms = 62.0
low_ms = 55.0
high_ms = 70.0
[intensity]
basis = "answers"
source = "25 pairs a point"
scale = "audio"
[[intensity.point]]
drive = 0.3
intensity = 0.2
sd = 0.02
[[intensity.point]]
drive = 0.6
intensity = 0.5
sd = 0.04
[[intensity.point]]
drive = 1.0
intensity = 0.8
sd = 0.08
"""


@st.composite
def profiles(draw):
    """Valid profiles: increasing drives above a threshold, with increasing intensities."""
    count = draw(st.integers(2, 7))
    drives, intensities = (
        sorted(draw(st.lists(st.integers(1, 1000), min_size=size, max_size=size, unique=True)))
        for size in (count + 1, count)
    )
    points = tuple(Point(d / 1000, i / 1000, 0.01) for d, i in zip(drives[1:], intensities, strict=True))
    profile = parse_profile(TEXT, "p.toml")
    threshold = replace(profile.threshold, drive=drives[0] / 1000, low=drives[0] / 2000, high=drives[0] / 999)
    return replace(
        profile, threshold=threshold, intensity=replace(profile.intensity, scale="audio", point=points)
    )
