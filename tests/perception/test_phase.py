from helpers import ScriptedPerceiver

from haptigraph.geometry import Phase
from haptigraph.messages import Capture
from haptigraph.perception.phase import PhasedPerceiver

TIP = (1.0, 2.0)


def test_adds_the_phase_of_a_capture_to_what_was_found(registration):
    inner = ScriptedPerceiver(registration, [TIP])
    perceive = PhasedPerceiver(inner, ("approach", "injection"))
    named = perceive(Capture(0, 0, None, phase="injection", phase_s=2.5))
    assert named.found == {**inner(Capture(0, 0, None)).found, "injection": Phase(2.5)}


def test_ignores_an_unknown_phase_and_none(registration):
    inner = ScriptedPerceiver(registration, [TIP])
    perceive = PhasedPerceiver(inner, ("approach",))
    for phase in ("", "lunch"):
        assert perceive(Capture(0, 0, None, phase=phase)) == inner(Capture(0, 0, None))
    perceive.reset()
    assert inner.resets == 1
