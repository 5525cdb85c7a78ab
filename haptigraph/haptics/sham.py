"""Sham haptic output: the patterns of a procedure at random times, whatever the state; no warning."""

import random
from collections.abc import Sequence

from msgspec.structs import replace

from haptigraph.haptics.pattern import NS_PER_MS
from haptigraph.messages import OFF, UNKNOWN, Conclusion, HapticCommand, Pattern

__all__ = ["ShamRenderer"]

SEGMENT_MS = (400, 2400)


class ShamRenderer:
    """Ignore what is concluded, except that the state is unknown, which silences any output.

    Time is divided into segments of random length. Each is silent or plays one of the patterns that repeat or
    continue, drawn uniformly; a pattern that follows a measure keeps its plain numbers.

    Args:
        patterns: The procedure's patterns.
        seed: Of the schedule, which depends on nothing else.
        duty: Expected share of segments that vibrate.
    """

    def __init__(self, patterns: Sequence[Pattern], seed: int, duty: float) -> None:
        vibrating = [replace(each, follow=()) for each in patterns if each.kind in ("continuous", "pulses")]
        self._patterns, self._seed, self._duty = vibrating, seed, duty
        self._playing, self._since_ns = OFF, 0
        self._until_ns: int | None = None
        self._random = random.Random(seed)

    def __call__(self, conclusion: Conclusion) -> HapticCommand:
        """Return the haptic command from this time on."""
        now_ns = conclusion.stamp_ns
        if self._until_ns is None:
            self._until_ns = now_ns
        while now_ns >= self._until_ns:
            self._since_ns, self._playing = self._until_ns, self._draw()
            self._until_ns += self._random.randint(*SEGMENT_MS) * NS_PER_MS
        if conclusion.state == UNKNOWN:
            return HapticCommand(now_ns, OFF, now_ns)
        return HapticCommand(now_ns, self._playing, self._since_ns)

    def reset(self) -> None:
        """Start the schedule again."""
        self._random = random.Random(self._seed)
        self._playing, self._since_ns, self._until_ns = OFF, 0, None

    def _draw(self) -> Pattern:
        if not self._patterns or self._random.random() >= self._duty:
            return OFF
        return self._patterns[int(self._random.random() * len(self._patterns))]
