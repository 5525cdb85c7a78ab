"""Turn surgical states into haptic commands by the procedure's grammar (paper, section II-D).

Remembers what is playing, so that a steady state keeps its rhythm and a one-shot plays once. Knows no device.
"""

from collections.abc import Iterable

from haptigraph.haptics.pattern import duration_ns
from haptigraph.messages import OFF, UNKNOWN, Conclusion, HapticCommand, Pattern

__all__ = ["GrammarRenderer"]


class GrammarRenderer:
    """Choose a pattern for every conclusion.

    Bursts start when their state is entered and play to their end, once, even if the state is left for a
    silent one; any other pattern, or losing the needle, cuts them short.

    Args:
        patterns: The procedure's patterns; every `feel` of its states is among them.
    """

    def __init__(self, patterns: Iterable[Pattern]) -> None:
        self._patterns = {pattern.name: pattern for pattern in patterns}
        self._playing, self._since_ns, self._state = OFF, 0, UNKNOWN

    def __call__(self, conclusion: Conclusion) -> HapticCommand:
        """Return what the hand feels from this moment on."""
        now_ns = conclusion.stamp_ns
        wanted = self._patterns[conclusion.feel]
        entered = conclusion.state != self._state
        self._state = conclusion.state
        if self._burst_is_over(now_ns):
            self._play(OFF, now_ns)
        if conclusion.state == UNKNOWN:
            self._play(OFF, now_ns)
        elif wanted.kind == "bursts":
            if entered:
                self._play(wanted, now_ns)
            elif self._playing.kind != "bursts":
                self._play(OFF, now_ns)
        elif wanted.kind != "off" or self._playing.kind != "bursts":
            self._play(OFF if wanted.kind == "off" else wanted, now_ns)
        return HapticCommand(now_ns, self._playing, self._since_ns)

    def reset(self) -> None:
        """Forget what is playing."""
        self._playing, self._since_ns, self._state = OFF, 0, UNKNOWN

    def _burst_is_over(self, now_ns: int) -> bool:
        length_ns = duration_ns(self._playing)
        return length_ns is not None and now_ns - self._since_ns >= length_ns

    def _play(self, pattern: Pattern, now_ns: int) -> None:
        if pattern != self._playing:
            self._playing, self._since_ns = pattern, now_ns
