"""Turn surgical states into haptic commands by the procedure's grammar (paper, section II-D).

Keeps track of the current pattern, so that a steady state keeps its rhythm and a one-shot plays once.
"""

from collections.abc import Iterable, Sequence

from haptigraph.config import HapticsConfig
from haptigraph.grammar import OFF, ForceField, Pattern
from haptigraph.haptics.guidance import Guidance
from haptigraph.haptics.pattern import NS_PER_MS, duration_ns, position_ns, with_weakest
from haptigraph.haptics.sham import ShamRenderer
from haptigraph.messages import TIP_NOT_VISIBLE, UNKNOWN, Conclusion, HapticCommand

__all__ = ["GrammarRenderer", "make_renderer"]


class GrammarRenderer:
    """Choose a pattern and the force fields for every conclusion.

    Numbers of a pattern may follow a measure; its rhythm continues meanwhile. Bursts start when their state
    is entered and play to the end, once, even if a silent state follows. Any other pattern, or the loss of
    the needle or its tip, cuts them short.

    Args:
        patterns: The procedure's patterns; every `feel` of its states is among them.
        forces: Its force fields; every `force` of its states is among them.
    """

    def __init__(self, patterns: Iterable[Pattern], forces: Iterable[ForceField] = ()) -> None:
        self._patterns = {pattern.name: pattern for pattern in patterns}
        self._forces = {force.name: force for force in forces}
        self._guidance = Guidance()
        self._playing, self._since_ns, self._state = OFF, 0, UNKNOWN
        self._left_ns: dict[str, int] = {}

    def __call__(self, conclusion: Conclusion) -> HapticCommand:
        """Return the haptic command from this time on."""
        now_ns = conclusion.stamp_ns
        pattern = self._guidance(self._patterns[conclusion.feel], conclusion.measures)
        entered = conclusion.state != self._state and self._is_armed(conclusion.state, pattern, now_ns)
        self._state = conclusion.state
        self._left_ns[conclusion.state] = now_ns
        if self._burst_is_over(now_ns):
            self._play(OFF, now_ns)
        is_tip_lost = conclusion.state == TIP_NOT_VISIBLE and pattern.kind == "off"
        if conclusion.state == UNKNOWN or is_tip_lost:
            self._play(OFF, now_ns)
        elif pattern.kind == "bursts":
            if entered:
                self._play(pattern, now_ns)
            elif self._playing.kind != "bursts":
                self._play(OFF, now_ns)
        elif pattern.kind != "off" or self._playing.kind != "bursts":
            self._play(OFF if pattern.kind == "off" else pattern, now_ns)
        forces = tuple([self._forces[name] for name in conclusion.forces])
        return HapticCommand(now_ns, self._playing, self._since_ns, forces)

    def reset(self) -> None:
        """Forget the current pattern."""
        self._playing, self._since_ns, self._state = OFF, 0, UNKNOWN
        self._left_ns.clear()
        self._guidance.reset()

    def _is_armed(self, state: str, pattern: Pattern, now_ns: int) -> bool:
        """Return whether a state was left long enough for its bursts to play again."""
        left_ns = self._left_ns.get(state)
        return left_ns is None or now_ns - left_ns >= pattern.rearm_ms * NS_PER_MS

    def _burst_is_over(self, now_ns: int) -> bool:
        length_ns = duration_ns(self._playing)
        return length_ns is not None and now_ns - self._since_ns >= length_ns

    def _play(self, pattern: Pattern, now_ns: int) -> None:
        """Play a pattern from its start; one that continues with other numbers keeps its rhythm."""
        if pattern == self._playing:
            return
        continues = pattern.name == self._playing.name
        self._since_ns = now_ns - (
            position_ns(self._playing, pattern, now_ns - self._since_ns) if continues else 0
        )
        self._playing = pattern


def make_renderer(
    patterns: Sequence[Pattern], forces: Sequence[ForceField], config: HapticsConfig
) -> GrammarRenderer | ShamRenderer:
    """Return the renderer of a configuration: of the grammar, as strong as set, or a sham without force."""
    patterns = with_weakest(patterns, config.weakest_amplitude)
    if config.sham_seed is not None:
        return ShamRenderer(patterns, config.sham_seed, config.sham_duty)
    return GrammarRenderer(patterns, forces)
