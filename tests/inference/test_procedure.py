import re

import paths
import pytest
from msgspec.structs import replace

from haptigraph.assemble import load_procedure, parse_procedure, procedure_names
from haptigraph.errors import BadInput, RenamedKey
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.prove import prove
from haptigraph.proof.report import Proof


@pytest.fixture(scope="module")
def text() -> str:
    return load_procedure("subretinal_injection").text


def changed(text: str, old: str, new: str) -> str:
    assert old in text, old
    return text.replace(old, new, 1)


def refuse(text: str) -> str:
    with pytest.raises(BadInput) as refused:
        parse_procedure(text, "p.toml")
    return str(refused.value)


def test_the_papers_eight_states_stand_in_order_with_the_one_without_a_tip(procedure):
    assert [state.name for state in procedure.states] == [
        "unknown",
        "tip_not_visible",
        "retinal_contact",
        "target_hit",
        "misaligned_retinal_approach",
        "aligned_retinal_approach",
        "misaligned_intraocular_navigation",
        "aligned_intraocular_navigation",
        "outside_eye",
    ]


def test_the_papers_thresholds(procedure):
    bounds = {
        relation.names[1:]: (relation.above, relation.at_most) for relation in procedure.schema.relations
    }
    assert bounds["touching", "retina_surface"] == (None, 0.7)
    assert bounds["approaching", "retina_surface"] == (0.7, 5.5)
    assert bounds["touching", "retina_target"] == (None, 0.7)
    assert bounds["approaching", "retina_target"] == (0.7, 5.5)
    assert bounds["aligned", "retina_target"] == (None, 1.7)
    assert bounds["misaligned", "retina_target"] == (1.7, None)


def test_the_onsets_of_the_double_burst_are_distinguishable(procedure):
    success = next(pattern for pattern in procedure.patterns if pattern.name == "success")
    assert success.count == 2
    assert success.on_ms == 100
    assert success.on_ms + success.off_ms >= 180


@pytest.mark.parametrize("name", procedure_names())
def test_shipped_procedures_are_valid_and_have_a_hash(name):
    assert re.fullmatch("[0-9a-f]{64}", load_procedure(name).sha256)


def test_a_procedure_can_be_loaded_from_a_path(text, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(changed(text, 'name = "subretinal_injection"', 'name = "mine"'))
    assert load_procedure(str(file)).name == "mine"


def test_the_error_for_an_unknown_procedure_suggests_an_existing_one():
    with pytest.raises(BadInput, match="unknown procedure 'subretinal'; did you mean 'subretinal_injection'"):
        load_procedure("subretinal")


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('feel = "pulse"', 'feel = "plse"', "unknown pattern 'plse'; did you mean 'pulse'?"),
        ('feel = "pulse"', 'feels = "pulse"', "unknown key 'feels'; did you mean 'feel'?"),
        ('feel = "pulse"', "feel = 3", "state[2].feel: expected str, got int, found 3"),
        ('feel = "off"\nbecause = "no', 'feel = "low"\nbecause = "no', "'unknown' must have a pattern of kind 'off'"),
        ('subject = "needle_tip"', 'subject = "needle_tp"', "unknown entity 'needle_tp'; did you mean 'needle_tip'"),
        ('measure = "distance_mm" ', 'measure = "gap_mm" ', "unknown measure 'gap_mm'"),
        ('measure = "distance_mm" ', 'measure = "theta_deg" ', "theta_deg measures segment to point, but needle_tip"),
        ("at_most = 0.7", "atmost = 0.7", "unknown key 'atmost'; did you mean 'at_most'?"),
        ("at_most = 0.7\n", "", "no bound; give at_most, below, at_least or above"),
        ("at_most = 0.7", "at_most = 0.7\nbelow = 1.0", "both at_most and below are given; one of them is enough"),
        ("above = 0.7", "above = 6.7", "no value is above 6.7 and below 5.5"),
        ("at_most = 0.7", "at_most = 0.7\nmargin_sd = -1", "margin_sd: expected float >= 0"),
        ("at_most = 0.7", "at_most = 0.7\nmargin_sd = 11", "margin_sd: expected float <= 10"),
        ("at_most = 0.7", "at_most = 0.7\nmargin_sd = nan", "nan"),
        ("at_most = 0.7", 'at_most = 0.7\nmargin_sd = "2"', "margin_sd: expected float, got str"),
        ("at_most = 0.7", "at_most = 0.7\nrelease = 0.6", "release 0.6 is within the bounds"),
        ('given = [["needle_tip", "touching"', 'given = [["needle_tip", "approaching"', ""),
        ('given = [["needle_tip", "touching", "retina_surface"]]', 'given = [["a", "b", "c"]]', "given <a, b, c> is no"),
        ('when = [["needle_tip", "touching", "retina_target"]]', 'when = [["needle_tip", "touching"]]', "of length 3"),
        ('when = [["needle_tip", "touching", "retina_target"]]', 'when = [["a", "b", "c"]]', "<a, b, c> is no relation"),
        ('absent = ["needle_tip"]', 'absent = ["needle"]', "unknown entity 'needle'"),
        ("{radial_mm:.2f}", "{radius_mm:.2f}", "unknown measure 'radius_mm'; did you mean 'radial_mm'?"),
        ("{radial_mm:.2f}", "{radial_mm:.2q}", "because cannot be filled in"),
        ("{radial_mm:.2f}", "{radial_mm", "because cannot be filled in"),
        ('kind = "continuous"', 'kind = "steady"', "unknown kind 'steady'; valid: bursts, continuous, off, pulses"),
        ("amplitude = 1.0", "amplitude = 1.5", "amplitude must be at most 1, found 1.5"),
        ("amplitude = 0.3", "amplitude = 0", "continuous needs amplitude above 0, found 0"),
        ("amplitude = 0.3", "amplitude = 0.3\non_ms = 5", "continuous has no on_ms, found 5"),
        ("frequency_hz = 80", "frequency_hz = -80", "frequency_hz must not be negative"),
        ("on_ms = 80", "on_ms = 1e305", "on_ms must be at most 3.6e+06, found 1e+305"),
        ("count = 2", "count = 99999", "count must be at most 1000, found 99999"),
        ("on_ms = 80", "on_ms = 0.0000001", "pulses needs on_ms of at least 1, found 1e-07"),
        ("off_ms = 80", "", "pulses needs off_ms of at least 1"),
        ("count = 2", "", "bursts needs count of at least 1"),
        ('geometry = "segment"', 'geometry = "line"', "unknown geometry 'line'"),
        ('name = "target_hit"', 'name = "retinal_contact"', "a second state 'retinal_contact'; names must differ"),
        ('name = "unknown"', 'name = "lost"', "no [[state]] named 'unknown'"),
        ('label = "target"', 'label = "retina"', "distance_to_retina_mm would mean both"),
        ("[procedure]", "[procedure", "not valid TOML"),
        ("[[entity]]", '[run]\nbegins = ["needle_tip", "in", "eye_globe"]\n[[entity]]', "<needle_tip, in, eye_globe> is no relation; there are: <"),
        ("[[entity]]", '[run]\nends_in = "hit"\n[[entity]]', "unknown state 'hit'"),
        ("{distance_to_target_mm:.1f}", "{distance_to_target_mm!r:.1f}", "because cannot be filled in (a measure is a number"),
        ('unless = [["needle_tip", "touching", "retina_target"]]', 'unless = [["needle_tip", "touching", "retina_surface"]]', "can never hold: <needle_tip, touching, retina_surface> is both required and excluded"),
        ('unless = [["needle_tip", "touching", "retina_target"]]', 'absent = ["needle_tip"]', "can never hold: <needle_tip, touching, retina_surface> is both required and excluded"),
        ('name = "target_hit"', 'name = " "', "a state without a name"),
        ('only_with = "needle_line"', 'visible_with = "trocar"', "visible_with 'trocar' is no entity declared before this one"),
        ('label = "shaft"', 'visible_with = "needle_tip"\nfixed = true', "both fixed and visible_with are given"),
        ('only_with = "needle_line"', 'only_with = "needle_tip"', "unknown entity 'needle_tip'; did you mean 'needle_line'?"),
        ('only_with = "needle_line"', 'only_with = "needle_line"\nfixed = true', "both fixed and only_with are given"),
        ('label = "shaft"', 'visible_with = "needle_tip"\nonly_with = "needle_tip"', "both visible_with and only_with are given"),
        ('label = "shaft"', 'visible_with = "needle_tip"\nseen_with = "needle_tip"', "both 'seen_with' and 'visible_with', which is its new name; keep 'visible_with'"),
        ('feels = ["pulse"]', 'feels = ["plse"]', "unknown pattern 'plse'; did you mean 'pulse'?"),
        ('feels = ["pulse"]\nstates = ["retinal_contact"]', "", "claims nothing; give one of feels, never_feels, states, never_states, forces, never_forces"),
        ('states = ["retinal_contact"]', 'states = ["contact"]', "unknown state 'contact'"),
        ('present = ["needle_tip"]', 'present = ["needle"]', "unknown entity 'needle'; did you mean 'needle_tip'?"),
        ('present = ["needle_tip"]', 'unless = [["a", "b", "c"]]', "<a, b, c> is no relation; there are: <needle_tip"),
        ('feels = ["pulse"]', 'feels = "pulse"', "expected array, got str, found 'pulse'"),
        ('name = "nothing vibrates when the tip is not seen"', 'name = "a needle that is seen is never unknown"', "a second invariant 'a needle that is seen is never unknown'"),
        ('measure = "distance_to_retina_mm"', 'measure = "distance_mm"', "unknown measure 'distance_mm'; did you mean 'distance_to_"),
        ('above = 5.5\nbecause', "because", "no bound; give at_most, below, at_least or above"),
        ('above = 5.5\nbecause', "above = 5.5\nat_least = 5.5\nbecause", "both at_least and above are given; one of them is enough"),
        ('above = 5.5\nbecause', "at_most = 5.5\nbelow = 5.5\nbecause", "both at_most and below are given; one of them is enough"),
        ('within_ms = 50', "", "give either feels and within_ms, or most_changes and in_ms"),
        ('within_ms = 50', "within_ms = 50\nmost_changes = 3", "give either feels and within_ms, or most_changes and in_ms"),
        ('within_ms = 50', "within_ms = 0", "expected"),
        ('feels = ["pulse"]\nwithin_ms', "within_ms", "within_ms needs feels and a premise"),
        ('absent = ["needle_tip"]\nfeels = ["off"]\nwithin_ms', 'feels = ["off"]\nwithin_ms', "within_ms needs feels and a premise"),
        ('most_changes = 6', 'most_changes = 6\nabsent = ["needle_tip"]', "most_changes applies to every graph; remove feels"),
        ('absent = ["needle_tip"]\nfeels = ["off"]\nwithin_ms', 'absent = ["needle"]\nfeels = ["off"]\nwithin_ms', "unknown entity 'needle'; did you mean 'needle_tip'?"),
        ('name = "it is silent within 50 ms of losing the tip"', 'name = "the alarm is felt within 50 ms of contact"', "a second temporal 'the alarm is felt within"),
        ('[[gap]]', '[[overlap]]\nrelations = [["a", "b", "c"], ["needle_tip", "touching", "retina_target"]]\nbecause = ""\n[[gap]]', "<a, b, c> is no relation"),
    ],
)  # fmt: skip
def test_every_mistake_is_one_sentence_with_its_line(text, old, new, problem):
    broken = changed(text, old, new)
    if not problem:  # a valid change: `given` may be an approach as well as a touch
        parse_procedure(broken, "p.toml")
        return
    message = refuse(broken)
    assert problem in message
    assert message.startswith("p.toml")
    assert "\n" not in message
    if "named 'unknown'" not in problem:
        line = int(re.search(r"line (\d+)", message)[1])
        wrong = broken.splitlines()[line - 1]
        assert wrong.strip() in broken and wrong.strip()


def test_the_line_is_that_of_the_mistake(text):
    broken = changed(text, 'feel = "pulse"', 'feel = "plse"')
    line = broken.splitlines().index('feel = "plse"') + 1
    assert refuse(broken).startswith(f"p.toml, line {line}: ")


def test_a_procedure_without_states_is_refused(text):
    assert "key 'state' is missing" in refuse(text[: text.index("[[state]]")])


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('key = "rate_hz"', 'key = "on_ms"', "unknown key 'on_ms'; valid: amplitude, frequency_hz, rate_hz"),
        ('measure = "theta_deg"\nstart', 'measure = "theta"\nstart', "unknown measure 'theta'; did you mean 'theta_deg'?"),
        ("end = [10.0, 0.6]", "end = [1.7, 0.6]", "start and end are both at 1.7"),
        ("end = [10.0, 0.6]", "end = [10.0, 1.2]", "amplitude must be above 0 and at most 1, found 1.2"),
        ("end = [0.7, 4.0]", "end = [0.7, 9.0]", "rate_hz must be above 0 and at most 8.264, found 9"),
        ('key = "amplitude"', 'key = "rate_hz"', "rate_hz cannot follow a measure here; continuous allows each of amplitude, frequency_hz once"),
        ("end = [10.0, 0.6]", "end = [10.0, 0.6]\ncurve = 0", "curve must be 0.1 to 10, found 0"),
        ("dead_band = 0.1", "dead_band = -0.1", "dead_band must not be negative, found -0.1"),
        ("rearm_ms = 1000", "rearm_ms = -5", "rearm_ms"),
        ('feel = "lean"', 'feel = "lean"\nhold_ms = 20000', "hold_ms"),
    ],
)  # fmt: skip
def test_an_invalid_follow_table_or_hold_is_reported_with_its_line(old, new, problem):
    text = load_procedure("subretinal_injection_continuous").text
    message = refuse(changed(text, old, new))
    assert problem in message
    assert message.startswith("p.toml")
    assert "line" in message


# --- keys by the names that they had in version 0.1


def content(procedure: Procedure) -> Procedure:
    return replace(procedure, text="")


def result(procedure: Procedure) -> Proof:
    return replace(prove(procedure), sha256="")


HAVE_RENAMED_KEYS = ("membrane_peeling", "subretinal_injection_ioct", "subretinal_injection_phases")


@pytest.mark.parametrize("name", HAVE_RENAMED_KEYS)
def test_old_keys_give_the_same_procedure_the_same_proof_and_a_sentence_for_each(name, tmp_path):
    new = load_procedure(name)
    text, count = re.subn("^visible_with = ", "seen_with = ", new.text, flags=re.MULTILINE)
    text, more = re.subn("^alias = ", "called = ", text, flags=re.MULTILINE)
    file = tmp_path / "old.toml"
    file.write_text(text)
    with pytest.warns(RenamedKey) as warned:
        old = load_procedure(str(file))
    assert content(old) == content(new)
    assert result(old) == result(new)
    sentences = {str(warning.message) for warning in warned}
    assert len(sentences) == count + more > 0
    for sentence in sentences:
        line = int(re.search(r"line (\d+)", sentence)[1])
        key = text.splitlines()[line - 1].partition(" ")[0]
        renamed = {"seen_with": "visible_with", "called": "alias"}[key]
        assert sentence == f"{file}, line {line}: key {key!r} is now called {renamed!r}"


@pytest.mark.parametrize(
    "file", sorted((paths.DATA / "v0_1" / "procedures").glob("*.toml")), ids=lambda file: file.stem
)
def test_the_text_of_a_procedure_of_version_0_1_in_a_recording_causes_no_warning(file):
    text = file.read_text()
    old = parse_procedure(text, "procedure in a recording")
    new = parse_procedure(text.replace("seen_with =", "visible_with =").replace("called =", "alias ="), "new")
    assert old.text != new.text
    assert content(old) == content(new)
    assert result(old) == result(new)
    violated = {claim.name for claim in result(old).claims if not claim.holds}
    assert violated <= {"alarm strongest", "alarm unlike"}  # claims that 0.1.0 did not make


def test_a_margin_is_refused_for_a_measure_without_standard_deviation():
    elapsed = 'measure = "elapsed_s"'
    phased = load_procedure("subretinal_injection_phases").text
    text = changed(phased, elapsed, f"{elapsed}\nmargin_sd = 2")
    assert "elapsed_s has no standard deviation; remove margin_sd, or use distance_mm, radial_mm," in refuse(
        text
    )


def test_a_state_that_does_not_say_its_kind_has_that_of_the_paper_or_of_its_pattern():
    procedure = load_procedure("subretinal_injection")
    text, count = re.subn(r'\nkind = "(alarm|guidance|success|neutral|unseen)"', "", procedure.text)
    text = text.replace('"retinal_contact"', '"touch"').replace('"target_hit"', '"there"')
    text = text.replace('"misaligned_retinal_approach"', '"askew"')
    kinds = parse_procedure(text, "x").kinds
    assert count == 9
    assert list(kinds.values()) == list(procedure.kinds.values())


def test_every_state_of_a_shipped_procedure_says_its_kind():
    for name in procedure_names():
        assert all(state.kind for state in load_procedure(name).states), name
