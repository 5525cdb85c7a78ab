"""Patterns that follow a measure: inverted, unnoticed and never reached ones are found, sensible ones pass."""

import pytest

from haptigraph.assemble import load_procedure, parse_procedure, procedure_names
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.claims.follow import follow_claims

INVERTED = {
    ("membrane_peeling", "start = [1.8, 0.1]\nend = [6.0, 0.5]", "start = [1.8, 0.5]\nend = [6.0, 0.1]"),
    ("membrane_peeling", "start = [4.0, 1.0]\nend = [0.5, 4.0]", "start = [4.0, 4.0]\nend = [0.5, 1.0]"),
    (
        "subretinal_injection_continuous",
        "start = [1.7, 0.15]\nend = [10.0, 0.6]",
        "start = [1.7, 0.6]\nend = [10.0, 0.15]",
    ),
    (
        "subretinal_injection_continuous",
        "start = [5.5, 1.5]\nend = [0.7, 4.0]",
        "start = [0.7, 1.5]\nend = [5.5, 4.0]",
    ),
    (
        "subretinal_injection_ioct",
        "start = [200, 2.0]\nend = [20, 5.0]",
        "start = [200, 5.0]\nend = [20, 2.0]",
    ),
    (
        "subretinal_injection_phases",
        "start = [0.0, 0.1]\nend = [-0.6, 0.6]",
        "start = [0.0, 0.6]\nend = [-0.6, 0.1]",
    ),
}
LEAN = "start = [1.7, 0.15]\nend = [10.0, 0.6]\ndead_band = 0.1"


def replaced(name: str, old: str, new: str) -> Procedure:
    text = load_procedure(name).text
    assert old in text
    return parse_procedure(text.replace(old, new, 1), "changed.toml")


def sentences(procedure: Procedure) -> list[str]:
    return [violation.sentence for claim in follow_claims(procedure) for violation in claim.violations]


@pytest.mark.parametrize("name", procedure_names())
def test_all_that_follows_a_measure_in_shipped_procedures_grows_and_is_decided(name):
    claims = follow_claims(load_procedure(name))
    assert all(claim.holds for claim in claims)
    assert not any("the rules do not say" in claim.statement for claim in claims)
    assert bool(claims) == any(pattern.follow for pattern in load_procedure(name).patterns)


@pytest.mark.parametrize(("name", "old", "new"), sorted(INVERTED))
def test_an_inverted_table_is_found(name, old, new):
    assert any(
        "becomes worse; swap the numbers" in sentence for sentence in sentences(replaced(name, old, new))
    )


def test_a_reason_makes_an_inverted_table_sound():
    inverted = (
        'start = [1.7, 0.6]\nend = [10.0, 0.15]\nbecause = "it fades out where no correction is possible"'
    )
    procedure = replaced(
        "subretinal_injection_continuous", "start = [1.7, 0.15]\nend = [10.0, 0.6]", inverted
    )
    assert not sentences(procedure)


@pytest.mark.parametrize(
    ("new", "problem"),
    [
        (LEAN.replace("dead_band = 0.1", "dead_band = 50"), "ignores changes of theta_deg up to 50"),
        (LEAN.replace("0.6]", "0.17]"), "which is not noticed"),
        (LEAN.replace("1.7,", "0.1,").replace("10.0,", "1.6,"), "but is felt from 1.7 to"),
    ],
)
def test_a_table_that_changes_nothing_is_found(new, problem):
    procedure = replaced("subretinal_injection_continuous", LEAN, new)
    assert any(problem in sentence for sentence in sentences(procedure))


@pytest.mark.parametrize(
    "new",
    [
        LEAN.replace("10.0,", "20.0,"),
        LEAN.replace("1.7,", "1.5,"),
        LEAN.replace("dead_band = 0.1", "dead_band = 1.0"),
        LEAN + "\ncurve = 2",
    ],
)
def test_sensible_tables_pass(new):
    assert not sentences(replaced("subretinal_injection_continuous", LEAN, new))


def test_the_order_of_rules_that_exclude_each_other_does_not_matter():
    text = load_procedure("subretinal_injection_continuous").text
    parts = text.split("[[state]]")
    names = [part.split('"')[1] for part in parts]
    one, other = (
        names.index("misaligned_intraocular_navigation"),
        names.index("aligned_intraocular_navigation"),
    )
    parts[one], parts[other] = parts[other], parts[one]
    assert not sentences(parse_procedure("[[state]]".join(parts), "swapped.toml"))
