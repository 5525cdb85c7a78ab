"""The documentation matches the code."""

import re
from pathlib import Path

import pytest
from paths import ROOT

from haptigraph import assemble
from haptigraph.analysis.plots.diagram import diagram_svg
from haptigraph.analysis.plots.scenario_diagram import scenario_svg
from haptigraph.proof.prove import prove
from haptigraph.recording.schema import TOPICS
from haptigraph.registration.loading import parse_registration
from haptigraph.scene.relations import MEASURES
from haptigraph.sim.scenario import Scenario, load_scenario, scenario_names
from haptigraph.sim.tissue import TissueShape
from haptigraph.study.data_dictionary import MEASURES as MEASURES_OF_TRIALS
from haptigraph.study.frozen.quality import Quality
from haptigraph.study.preparation.calibration import Calibration
from haptigraph.study.preparation.training import Training
from haptigraph.study.protocol import (
    Condition,
    QuestionnaireTable,
    Stop,
    StudyTable,
    Target,
    Texts,
    Trials,
)
from haptigraph.toml_document import Document

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def test_readme_program_runs_and_equals_the_example(quick_uri, capsys):
    (program,) = blocks(read("README.md"), "python")
    assert program == read("examples/states_and_touch.py")
    assert len(program.strip().splitlines()) <= 13
    exec(program.replace("phantom:align_then_approach", quick_uri), {})
    output = capsys.readouterr().out
    assert "target_hit" in output
    assert "images/s" in output


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub makes them."""
    prose = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_pictures_and_anchors_exist(page):
    for target, anchor in re.findall(r"\]\(([^)#\s]*)#?([^)\s]*)\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            linked = (page.parent / target).resolve() if target else page
            if linked.parent == ROOT / "docs" / "notebooks":  # copied there when the site is built
                linked = ROOT / "examples" / "notebooks" / linked.name
            assert linked.exists(), target
            assert not anchor or anchor in anchors(linked), f"{target}#{anchor}"


SHIPPED = ("haptigraph", "examples", "rig", "training", "rendering", "benchmarks")
NAMED_PAGE = re.compile(r"(?<![\w/.-])(docs/[\w/-]+\.md)(?:#([\w-]+))?")


def test_pages_that_code_messages_and_shipped_files_name_exist():
    named = 0
    for folder in SHIPPED:
        for path in (ROOT / folder).rglob("*"):
            if path.suffix not in {
                ".py",
                ".toml",
                ".md",
                ".js",
                ".html",
                ".css",
                ".ipynb",
                ".c",
                ".h",
                ".rst",
            }:
                continue
            for page, anchor in NAMED_PAGE.findall(path.read_text(encoding="utf-8")):
                named += 1
                assert (ROOT / page).is_file(), f"{path} names {page}"
                assert not anchor or anchor in anchors(ROOT / page), f"{path} names {page}#{anchor}"
    assert named > 40


def test_paths_in_the_architecture_exist():
    for path in re.findall(r"`([\w*]+/[\w/*]+(?:\.\w+|/))`", read("docs/explanation/architecture.md")):
        assert [*ROOT.glob(path), *(ROOT / "haptigraph").glob(path)], path


def test_recordings_page_lists_every_topic():
    text = read("docs/reference/recordings.md")
    for topic in TOPICS:
        assert f"| `{topic.name}` | `{topic.schema}` | {topic.unit or '-'} | {topic.says} |" in text


def test_study_page_lists_every_protocol_key_and_measure():
    text = read("docs/reference/studies.md")
    tables = {"study": StudyTable, "condition": Condition, "training": Training, "trials": Trials}
    tables |= {"target": Target, "questionnaire": QuestionnaireTable, "stop": Stop, "texts": Texts}
    tables |= {"quality": Quality, "calibration": Calibration}
    for table, struct in tables.items():
        for key in struct.__struct_fields__:
            assert f"`{table}.{key}`" in text, f"{table}.{key}"
    for field in MEASURES_OF_TRIALS:
        assert f"`{field.name}`" in text


def test_procedures_page_lists_every_measure_and_pattern_kind():
    text = read("docs/reference/procedures.md")
    for name in MEASURES:
        assert f"`{name}`" in text
    for kind in ("off", "continuous", "pulses", "bursts"):
        assert f'`"{kind}"`' in text


@pytest.mark.parametrize("part", ["invariant", "gap", "overlap", "temporal"])
def test_example_parts_of_procedures_are_valid(part, procedure):
    page = blocks(read("docs/reference/procedures.md"), "toml")
    (text,) = [block for block in page if "[procedure]" not in block and block.startswith(f"[[{part}]]")]
    whole = procedure.text
    if part == "gap":  # it is the one that ships
        assert text in whole
        whole = whole.replace(text, "")
        assert not prove(assemble.parse_procedure(whole, "p.toml")).holds
    if part == "overlap":
        misled = whole.replace("at_most = 1.7", "at_most = 1.7\nrelease = 2.0")
        sentences = [one.sentence for one in prove(assemble.parse_procedure(misled, "p.toml")).violations]
        assert any(
            "misaligned_intraocular_navigation', which feels 'low'" in sentence for sentence in sentences
        )
        whole = whole.replace("at_most = 0.7", "at_most = 0.7\nrelease = 0.8", 1)
        assert not prove(assemble.parse_procedure(whole, "p.toml")).holds
    assert prove(assemble.parse_procedure(whole + "\n" + text, "p.toml")).violations == []


TUTORIAL = "docs/tutorials/own_operation.md"


def test_scenario_diagram_is_current(tmp_path):
    (scenario,) = [part for part in blocks(read(TUTORIAL), "toml") if "[scenario]" in part]
    (tmp_path / "my_eye.toml").write_text(scenario)
    assert read("docs/images/scenario.svg") == scenario_svg(load_scenario(str(tmp_path / "my_eye.toml")))


def test_state_diagram_is_current(procedure):
    assert read("docs/images/states.svg") == diagram_svg(procedure)


def test_example_pattern_that_follows_a_measure_loads():
    (lean,) = [
        block
        for block in blocks(read("docs/reference/procedures.md"), "toml")
        if "[[pattern.follow]]" in block
    ]
    shipped = assemble.load_procedure("subretinal_injection_continuous").text
    start, end = shipped.index('[[pattern]]\nname = "lean"'), shipped.index('[[pattern]]\nname = "near"')
    assert assemble.parse_procedure(
        shipped[:start] + lean + shipped[end:], "docs/reference/procedures.md"
    ).patterns


def test_example_registration_loads():
    (registration,) = [b for b in blocks(read("docs/reference/conventions.md"), "toml") if "[[trocar]]" in b]
    assert parse_registration(registration, "docs/reference/conventions.md").width_px == 1280


def test_example_tissue_loads_and_states_the_defaults():
    (text,) = [
        block for block in blocks(read("docs/reference/conventions.md"), "toml") if "[tissue]" in block
    ]
    rest = '[scenario]\ndescription = "x"\n[[move]]\nduration_s = 1\ndepth_mm = 0\ntheta_deg = 0\n'
    assert Document(text + rest, "docs/reference/conventions.md").convert(Scenario).tissue
    for key in TissueShape.__struct_fields__:
        assert re.search(rf"^{key} = .*\({getattr(TissueShape(), key):g}\)", text, re.MULTILINE), key


def test_python_blocks_compile():
    for page in PAGES:
        for block in blocks(page.read_text(encoding="utf-8"), "python"):
            compile(block, page.name, "exec")


def test_conventions_page_lists_every_scenario():
    for name in scenario_names():
        assert f"| `{name}` |" in read("docs/reference/conventions.md")


def test_disclaimer_is_present():
    for name in ("README.md", "docs/explanation/safety.md"):
        assert "not a medical device" in read(name)
