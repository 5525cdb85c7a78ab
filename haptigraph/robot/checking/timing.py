"""Check rates, stamps, latency and liveness of measured_cp."""

from collections.abc import Iterator

import numpy as np

from haptigraph.findings import Finding
from haptigraph.robot.checking.recorded import Recorded
from haptigraph.robot.ros.stamps import MAX_AGE_NS

__all__ = ["MIN_POSES", "stamps_are_usable", "timing_findings", "timing_measurements"]

MIN_POSES = 10
MAX_AHEAD_S = 0.005  # a clock that is further ahead hides as much of a pose's age
FROZEN_SHARE = 0.5  # of the stamps, or poses, that repeat the one before


def timing_findings(recorded: Recorded, stale_ms: float) -> Iterator[Finding]:
    """Yield the problems of time.

    Args:
        recorded: At least `MIN_POSES` poses.
        stale_ms: Age of a pose at which the robot is held.
    """
    samples = recorded.poses.samples()
    stamps = list(_stamps(recorded))
    yield from stamps
    arrivals_ms = 1e3 * np.diff(samples.received_s)
    period_ms = 1e3 * float(np.median(np.diff(samples.received_s if stamps else samples.stamp_s)))
    gap_ms = float(np.percentile(arrivals_ms, 95))
    if (mean_ms := float(arrivals_ms.mean())) > stale_ms / 2:
        yield Finding(
            "rate",
            f"measured_cp has {1e3 / mean_ms:.3g} messages/s; at least {2e3 / stale_ms:.3g} are valid, as a "
            f"pose is stale after {stale_ms:g} ms and one may be lost",
        )
    elif gap_ms > stale_ms:
        yield Finding(
            "bursts",
            f"poses of measured_cp arrive in bursts, up to {gap_ms:.3g} ms apart; less than {stale_ms:g} ms "
            "(limits.stale_ms) is valid",
        )
    if not stamps and (age_ms := 1e3 * float(np.median(samples.age_s))) + period_ms > stale_ms:
        yield Finding(
            "latency",
            f"poses arrive {age_ms:.4g} ms after their stamp; at most {stale_ms - period_ms:.3g} ms is "
            f"valid, as a pose is stale after {stale_ms:g} ms: a slow network, or clocks that are not "
            "synchronised",
        )


def timing_measurements(recorded: Recorded) -> dict[str, float]:
    """Return rate, gaps and age of the poses."""
    samples = recorded.poses.samples()
    arrivals_ms = 1e3 * np.diff(samples.received_s)
    measured = {
        "pose_rate_hz": 1e3 / float(arrivals_ms.mean()),
        "pose_gap_p99_ms": float(np.percentile(arrivals_ms, 99)),
    }
    if stamps_are_usable(recorded):
        ages_ms = 1e3 * samples.age_s
        measured["pose_age_median_ms"] = float(np.median(ages_ms))
        measured["pose_age_p99_ms"] = float(np.percentile(ages_ms, 99))
    return measured


def stamps_are_usable(recorded: Recorded) -> bool:
    """Return whether the stamps of the poses advance and agree with this machine's clock."""
    return next(_stamps(recorded), None) is None


def _stamps(recorded: Recorded) -> Iterator[Finding]:
    if recorded.poses.unstamped:
        yield Finding(
            "stamps_missing",
            f"{recorded.poses.unstamped} of {len(recorded.poses)} poses have no stamp; the time of "
            "measurement is valid",
        )
        return
    samples = recorded.poses.samples()
    steps_s = np.diff(samples.stamp_s)
    if np.mean(steps_s == 0) > FROZEN_SHARE:
        yield Finding(
            "stamps_frozen",
            f"{np.mean(steps_s == 0):.0%} of the poses repeat the stamp before; advancing stamps are valid",
        )
        return
    if len(recorded.poses.senders) == 1 and (steps_s < 0).any():
        yield Finding(
            "stamps_backwards", f"{(steps_s < 0).sum()} stamps are older than the one before; none is valid"
        )
    age_s = float(np.median(samples.age_s))
    if float(np.percentile(samples.age_s, 5)) < -MAX_AHEAD_S:
        yield Finding(
            "stamps_future",
            f"stamps are {-age_s:.3g} s in the future; at most {MAX_AHEAD_S * 1e3:g} ms is valid: "
            "synchronise the clocks of the two machines (NTP, PTP)",
        )
    elif age_s > MAX_AGE_NS / 1e9:
        yield Finding(
            "stamps_past",
            f"stamps are {age_s:.4g} s in the past; less than {MAX_AGE_NS / 1e9:g} s is valid: synchronise "
            "the clocks of the two machines (NTP, PTP)",
        )
