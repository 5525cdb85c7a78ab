"""Slips in shipped procedures are found; every mutant that is accepted is explained."""

import pytest
from procedure_mutants import FELT, PLAUSIBLE, SAME, mutants, run, table

from haptigraph.assemble import procedure_names


def test_a_slip_of_units_in_one_threshold_is_always_found():
    outcome = run(("subretinal_injection",), ("threshold x 1000", "threshold / 1000", "threshold x 57.3"))
    assert outcome.made == {"threshold x 1000": 8, "threshold / 1000": 8, "threshold x 57.3": 2}
    assert outcome.escapes == []


def test_a_mutant_changes_one_thing(procedure):
    for mutant in mutants("subretinal_injection"):
        assert mutant.text != procedure.text, mutant.what


def test_states_that_may_be_exchanged_are_looked_at_in_every_graph():
    outcome = run(("subretinal_injection",), ("two states swapped",))
    assert {reason for _, _, reason in outcome.escapes} == {SAME}
    assert "| two states swapped | 36 |" in table(outcome)


@pytest.mark.slow
def test_nearly_all_mutants_of_all_procedures_are_found_and_the_others_explained():
    outcome = run(tuple(procedure_names()))
    caught = outcome.caught
    for sort in ("threshold x 1000", "threshold / 1000", "threshold x 57.3"):
        assert caught[sort] == outcome.made[sort], sort
    assert all(reason for _, _, reason in outcome.escapes)
    differing = [reason for _, _, reason in outcome.escapes if reason in (FELT, PLAUSIBLE)]
    assert len(differing) <= 0.06 * outcome.made.total()
