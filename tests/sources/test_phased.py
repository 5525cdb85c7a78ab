"""Who says the phase: a person before the source, the source before the first."""

import pytest

from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.sources.phased import PhasedSource, phased

PHASES = ("insertion", "approach", "injection")
S = 1_000_000_000


class Told:
    """A source whose images come one a second, with the phases that a list says."""

    rate_hz, is_live, registration = 1.0, False, None

    def __init__(self, phases):
        self._captures = iter(Capture(n, n * S, None, phase=phase) for n, phase in enumerate(phases))
        self.closed = False

    def read(self, timeout_s):
        return next(self._captures, None)

    def close(self):
        self.closed = True


def read(source):
    capture = source.read(1.0)
    return capture.phase, capture.phase_s


def test_it_begins_with_the_first_or_the_one_asked_for():
    assert read(phased(Told([""]), PHASES, "")) == ("insertion", 0.0)
    assert read(phased(Told([""]), PHASES, "approach")) == ("approach", 0.0)


def test_a_person_comes_before_the_source_and_the_time_is_counted_from_the_change():
    source = PhasedSource(Told(["", "approach", "approach", "approach", "approach"]), PHASES)
    assert [read(source) for _ in range(3)] == [("insertion", 0.0), ("approach", 0.0), ("approach", 1.0)]
    source.named = "injection"
    assert [read(source) for _ in range(2)] == [("injection", 0.0), ("injection", 1.0)]
    assert source.read(1.0) is None


def test_a_procedure_without_phases_leaves_the_source_alone():
    source = Told([""])
    assert phased(source, (), "") is source


@pytest.mark.parametrize(("phases", "told"), [(PHASES, "did you mean 'injection'"), ((), "unknown phase")])
def test_an_unknown_phase_is_refused(phases, told):
    with pytest.raises(BadInput, match=told):
        phased(Told([""]), phases, "injectoin")


def test_closing_closes_the_source():
    source = Told([""])
    phased(source, PHASES, "").close()
    assert source.closed
