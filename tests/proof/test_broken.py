"""Every procedure with a usual mistake is refused or violates a claim; sensible variants pass."""

import re

import pytest
from broken_procedures import BROKEN, SENSIBLE

from haptigraph.assemble import load_procedure, perceiver_class, perceiver_name
from haptigraph.config import Config
from haptigraph.errors import BadInput
from haptigraph.proof.prove import prove
from haptigraph.run_device import device_class


def sentences(text, folder, device="", perceiver="auto"):
    """Return what `check` says against a procedure; none if it accepts it."""
    file = folder / "mine.toml"
    file.write_text(text)
    try:
        procedure = load_procedure(str(file))
    except BadInput as refused:
        return [str(refused)]
    name = perceiver_name(Config().with_perceiver(perceiver), procedure)
    played = (device, device_class(device).capabilities) if device else None
    proof = prove(procedure, device=played, perceiver=(name, perceiver_class(name)))
    return [violation.sentence for violation in proof.violations]


@pytest.mark.parametrize("case", BROKEN, ids=lambda case: case.name)
def test_a_broken_procedure_is_refused_in_one_sentence(case, tmp_path):
    said = sentences(case.text, tmp_path, case.device, case.perceiver or "auto")
    assert any(re.search(case.says, sentence) for sentence in said), said
    assert all(sentence.count("\n") == 0 and len(sentence) < 400 for sentence in said)


@pytest.mark.parametrize("name", SENSIBLE)
def test_a_sensible_variant_passes(name, tmp_path):
    assert sentences(SENSIBLE[name], tmp_path) == []


def test_the_suite_has_at_least_60_broken_and_10_sensible_procedures():
    assert len({case.text for case in BROKEN}) >= 60
    assert len(set(SENSIBLE.values())) >= 10
