import pytest

from haptigraph.run_report import Durations


def test_percentiles_are_accurate_to_a_percent():
    durations = Durations()
    for us in range(1, 1001):
        durations.add(us * 1000)
    assert durations.percentile_ms(50) == pytest.approx(0.5, rel=0.02)
    assert durations.percentile_ms(99) == pytest.approx(0.99, rel=0.02)
    durations.add(0)
    durations.add(10**18)
    assert Durations().percentile_ms(50) != Durations().percentile_ms(50)  # nan
