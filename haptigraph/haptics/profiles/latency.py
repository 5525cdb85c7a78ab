"""The round trip of a command to a device that confirms: measured with silence alone, so nothing vibrates."""

import math
from collections.abc import Callable

import numpy as np

from haptigraph.haptics.profiles.profile import Latency
from haptigraph.stages import Device

__all__ = ["measure_latency"]

COMMANDS = 200
Z_975 = 1.96


def measure_latency(device: Device, now_ns: Callable[[], int]) -> Latency:
    """Measure median and 95th percentile of the round trip; their intervals are those of order statistics.

    Args:
        device: A silent device that confirms every command.
        now_ns: A clock of high resolution.

    Raises:
        DeviceError: If the device fails.
    """
    durations_ms = []
    for _ in range(COMMANDS):
        started_ns = now_ns()
        device.set(0.0, 0.0, started_ns)
        durations_ms.append((now_ns() - started_ns) / 1e6)
    ordered = np.sort(durations_ms).tolist()
    p50, p95 = _percentile(ordered, 0.5), _percentile(ordered, 0.95)
    return Latency(
        basis="measured",
        source=f"{COMMANDS} commands of silence, by the clock of this machine",
        commands=COMMANDS,
        p50_ms=p50[1],
        p50_low_ms=p50[0],
        p50_high_ms=p50[2],
        p95_ms=p95[1],
        p95_low_ms=p95[0],
        p95_high_ms=p95[2],
    )


def _percentile(ordered: list[float], share: float) -> tuple[float, float, float]:
    """Return a percentile between the limits of its interval, whatever the distribution."""
    center, half = len(ordered) * share, Z_975 * math.sqrt(len(ordered) * share * (1 - share))
    ranks = (math.floor(center - half), math.ceil(center), math.ceil(center + half) + 1)
    low, value, high = (ordered[min(max(rank, 1), len(ordered)) - 1] for rank in ranks)
    return low, value, high
