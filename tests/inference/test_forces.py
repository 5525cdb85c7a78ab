import re

import pytest
from helpers import observe, on_axis

from haptigraph.analysis.plots.explanation import force_text
from haptigraph.assemble import build_pipeline, load_procedure, parse_procedure, procedure_names
from haptigraph.config import Config
from haptigraph.errors import BadInput
from haptigraph.haptics.force.fixture import fixtures_of
from haptigraph.haptics.renderer import GrammarRenderer
from haptigraph.inference.engine import RuleEngine
from haptigraph.messages import Capture
from haptigraph.proof.prove import prove
from haptigraph.scene.builder import SchemaSceneBuilder

NAME = "subretinal_injection_force"


@pytest.fixture(scope="module")
def text() -> str:
    return load_procedure(NAME).text


def refuse(text: str, old: str, new: str) -> str:
    assert old in text, old
    with pytest.raises(BadInput) as refused:
        parse_procedure(text.replace(old, new, 1), "p.toml")
    return str(refused.value)


def line_of(text: str, words: str) -> int:
    return text[: text.index(words)].count("\n") + 1


def test_only_the_variant_with_force_exerts_any():
    assert {name for name in procedure_names() if load_procedure(name).forces} == {NAME}


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('force = ["guide"]', 'force = ["gide"]', "unknown force 'gide'; did you mean 'guide'?"),
        ('force = ["guide"]', 'force = ["guide", "guide"]', "force 'guide' is listed twice"),
        ("half_angle_deg = 1.7", "", "cone needs half_angle_deg above 0 and at most 45, found 0"),
        ("half_angle_deg = 1.7", "height_mm = 1.0\nhalf_angle_deg = 1.7", "cone has no height_mm, found 1"),
        ("height_mm = 0.9", "height_mm = -0.9", "height_mm must be 0 to 25, found -0.9"),
        ("height_mm = 0.9", "height_mm = nan", "height_mm: expected a finite number, found nan"),
        ("stiffness_n_per_mm = 1.0", "stiffness_n_per_mm = 50", "above 0 and at most 5, found 50"),
        ("damping_n_s_per_mm = 0.01", "damping_n_s_per_mm = inf", "expected a finite number, found inf"),
        ("limit_n = 3.0", "limit_n = 0", "limit_n must be above 0 and at most 10, found 0"),
        ("limit_n = 3.0", "limit_n = 100", "limit_n must be above 0 and at most 10, found 100"),
        ('name = "drag" ', 'name = "floor" ', "a second force 'floor'; names must differ"),
        ("limit_n = 3.0", "newton = 3.0", "newton"),
        ('kind = "viscous"', 'kind = "magnet"', "magnet"),
        ('never_forces = ["guide", "floor"]', 'never_forces = ["gide"]', "unknown force 'gide'"),
    ],
)
def test_a_mistake_is_one_sentence(text, old, new, problem):
    refusal = refuse(text, old, new)
    assert problem in refusal
    assert refusal.startswith("p.toml")
    assert "\n" not in refusal


@pytest.mark.parametrize("state", ["unknown", "tip_not_visible"])
def test_no_force_where_no_tip_is_seen(text, state):
    old = f'name = "{state}"\n'
    refusal = refuse(text, old, f'{old}force = ["drag"]\n')
    assert f"{state!r} must not exert a force, because no tip is seen" in refusal
    assert f"line {line_of(text, old) + 1}" in refusal


def test_no_force_in_a_state_that_needs_the_tips_absence(text):
    absent = 'absent = ["needle_tip"]\nfeel'
    assert absent in text
    renamed = text.replace("tip_not_visible", "lost")
    with pytest.raises(BadInput, match="'lost' must not exert a force"):
        parse_procedure(renamed.replace(absent, f'force = ["drag"]\n{absent}', 1), "p.toml")


def test_a_force_needs_the_entities_that_place_it(text):
    without = re.sub(r'\[\[entity\]\]\nname = "trocar".*?\n\n', "", text, flags=re.DOTALL)
    with pytest.raises(BadInput, match=r"cone needs an \[\[entity\]\] named 'trocar'"):
        parse_procedure(without, "p.toml")


def test_a_force_without_its_table_is_refused_with_what_to_add(text):
    without = re.sub(r"\[\[force\]\]\n.*?\n\n", "", text, flags=re.DOTALL)
    with pytest.raises(BadInput, match=r"is not defined; add a \[\[force\]\] of that name"):
        parse_procedure(without, "p.toml")


def test_the_proof_finds_a_force_without_a_tip(text):
    unsafe = text.replace('absent = ["needle_tip"]\nfeel', 'absent = ["eye_globe"]\nfeel').replace(
        'name = "outside_eye"\nkind = "neutral"\nwhen = [["needle_tip", "outside", "eye_globe"]]',
        'name = "outside_eye"\nkind = "neutral"\nforce = ["drag"]',
    )
    claims = {claim.name: claim for claim in prove(parse_procedure(unsafe, "p.toml"), "exhaustive").claims}
    (violation,) = claims["force unseen"].violations
    assert "'outside_eye' exerts drag although no tip is seen" in violation.sentence
    assert violation.graph is not None
    assert all(node.id != "needle_tip" for node in violation.graph.nodes)


def test_the_proof_finds_a_force_that_nothing_uses_or_that_breaks_a_claim(text):
    unused = text.replace('force = ["guide", "floor", "drag"]\n', "").replace('force = ["guide"]\n', "")
    broken = {claim.name for claim in prove(parse_procedure(unused, "p.toml")).claims if not claim.holds}
    assert broken == {"force used", "invariant"}
    assert prove(load_procedure(NAME)).holds


def test_what_no_claim_says_about_force_is_listed(text):
    silent = text.replace("floor above", "").replace('"guide", "floor", "drag"', '"guide", "floor"')
    silent = re.sub(r'forces = \["drag"\]\n', "", silent)
    uncovered = prove(parse_procedure(silent, "p.toml")).uncovered
    assert any(phrase.startswith("when drag pushes the hand") for phrase in uncovered)


def forces_at(registration, depth_mm: float, theta_deg: float = 0.0) -> set[str]:
    procedure = load_procedure(NAME)
    tip_mm = on_axis(registration.anatomy, depth_mm, theta_deg)
    graph = SchemaSceneBuilder(procedure.schema)(observe(registration.anatomy, tip_mm))
    conclusion = RuleEngine(procedure)(graph)
    command = GrammarRenderer(procedure.patterns, procedure.forces)(conclusion)
    assert tuple(force.name for force in command.forces) == conclusion.forces
    return {*conclusion.forces}


def test_states_exert_the_forces_that_they_name(registration):
    assert forces_at(registration, 8.0) == set()
    assert forces_at(registration, 8.0, 5.0) == {"guide"}
    assert forces_at(registration, 20.0, 5.0) == {"guide", "floor", "drag"}


def test_without_an_image_no_force_is_commanded(registration):
    pipeline = build_pipeline(Config(), registration, load_procedure(NAME))
    step = pipeline.step(Capture(0, 0, None))
    assert (step.conclusion.forces, step.command.forces, fixtures_of(step)) == ((), (), ())


def test_a_force_reads_as_a_sentence():
    texts = {field.name: force_text(field) for field in load_procedure(NAME).forces}
    floor = "away from the retina, below a height of 0.9 mm; 1 N/mm and 0.002 N s/mm, at most 3 N"
    assert texts["floor"] == floor
