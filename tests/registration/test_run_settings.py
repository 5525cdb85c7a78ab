"""What a run changes in its configuration."""

import pytest
from msgspec.structs import replace

from haptigraph.config import Config
from haptigraph.registration.loading import parse_registration
from haptigraph.run_settings import suited

SCANS = """format = 1
[image]
width = 64
height = 64
[scale]
axial_mm_per_px = 0.005
lateral_mm_per_px = 0.01
"""
VOLUMES = SCANS + "[volume]\nslices = 20\nslice_mm = 0.05\n"
TARGET = "[target]\ndepth_share = 0.5\n"


class Rate:
    def __init__(self, rate_hz):
        self.rate_hz = rate_hz


def limits_of(text, rate_hz, config=None):
    config = suited(config or Config(), Rate(rate_hz), parse_registration(text, "r.toml"))
    return config.haptics.deadman_ms, config.run.stale_ms


@pytest.mark.parametrize(
    ("rate_hz", "limits"), [(4, (375, 375)), (12, (150, 125)), (100, (150, 100)), (1, (1000, 1500))]
)
def test_an_output_is_valid_for_one_and_a_half_periods_of_volumes(rate_hz, limits):
    assert limits_of(VOLUMES + TARGET, rate_hz) == limits


def test_images_keep_their_limits():
    assert limits_of(SCANS + TARGET, 4) == (150, 100)


def test_limits_that_are_set_are_kept():
    config = Config()
    config = replace(
        config, haptics=replace(config.haptics, deadman_ms=200.0), run=replace(config.run, stale_ms=300.0)
    )
    assert limits_of(VOLUMES + TARGET, 4, config) == (200, 300)


def test_nothing_vibrates_on_assumptions_that_nobody_accepted():
    config, source, assumed = Config(), Rate(30), parse_registration(SCANS, "r.toml")
    assert suited(config, source, assumed).haptics.max_amplitude == 0
    accepted = replace(config, haptics=replace(config.haptics, accept_assumed=True))
    assert suited(accepted, source, assumed).haptics.max_amplitude == 1
