"""Precedence of phases: a person's, then the source's, then the initial one."""

import pytest

from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.sources.phased import PhasedSource, phased
from haptigraph.stages import Source

PHASES = ("insertion", "approach", "injection")
S = 1_000_000_000


class Scripted(Source):
    """A source of one image per second, with the listed phases."""

    rate_hz, is_live = 1.0, False

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


def test_the_initial_phase_is_the_first_or_the_configured_one():
    assert read(phased(Scripted([""]), PHASES, "")) == ("insertion", 0.0)
    assert read(phased(Scripted([""]), PHASES, "approach")) == ("approach", 0.0)


def test_a_persons_phase_overrides_the_sources_and_its_time_starts_at_the_change():
    source = PhasedSource(Scripted(["", "approach", "approach", "approach", "approach"]), PHASES)
    assert [read(source) for _ in range(3)] == [("insertion", 0.0), ("approach", 0.0), ("approach", 1.0)]
    source.named = "injection"
    assert [read(source) for _ in range(2)] == [("injection", 0.0), ("injection", 1.0)]
    assert source.read(1.0) is None


def test_without_phases_the_source_is_not_wrapped():
    source = Scripted([""])
    assert phased(source, (), "") is source


@pytest.mark.parametrize(("phases", "problem"), [(PHASES, "did you mean 'injection'"), ((), "unknown phase")])
def test_an_unknown_phase_is_rejected(phases, problem):
    with pytest.raises(BadInput, match=problem):
        phased(Scripted([""]), phases, "injectoin")


def test_closing_closes_the_wrapped_source():
    source = Scripted([""])
    phased(source, PHASES, "").close()
    assert source.closed
