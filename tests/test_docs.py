"""What the documents say is so."""

import re
from pathlib import Path

import pytest

from haptigraph import assemble
from haptigraph.cli import main
from haptigraph.config import Config
from haptigraph.perception.registration import parse_registration
from haptigraph.recording.schema import TOPICS
from haptigraph.scene.relations import MEASURES
from haptigraph.sim.scenario import scenario_names

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def test_the_program_in_the_readme_runs_and_is_the_example(quick_uri, capsys):
    (program,) = blocks(read("README.md"), "python")
    assert program == read("examples/states_and_touch.py")
    assert len(program.strip().splitlines()) <= 13
    exec(program.replace("phantom:align_then_approach", quick_uri), {})
    told = capsys.readouterr().out
    assert "target_hit" in told
    assert "images/s" in told


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


def test_every_command_stands_in_the_readme():
    for command in main.commands:
        assert f"haptigraph {command}" in read("README.md")


def test_the_table_of_topics_is_the_published_one():
    text = read("docs/recordings.md")
    for topic in TOPICS:
        assert f"| `{topic.name}` | `{topic.schema}` | {topic.unit or '-'} | {topic.says} |" in text


def test_every_setting_stands_in_the_conventions():
    text = read("docs/conventions.md")
    for table in Config.__struct_fields__:
        for key in getattr(Config(), table).__struct_fields__:
            assert f"`{table}.{key}`" in text, f"{table}.{key}"


def test_every_measure_and_pattern_kind_stands_in_the_procedures_page():
    text = read("docs/procedures.md")
    for name in MEASURES:
        assert f"`{name}`" in text
    for kind in ("off", "continuous", "pulses", "bursts"):
        assert f'`"{kind}"`' in text


def test_the_procedure_taught_in_the_docs_loads():
    (procedure,) = [block for block in blocks(read("docs/procedures.md"), "toml") if "[procedure]" in block]
    assert assemble.parse_procedure(procedure, "docs/procedures.md").name == "touch_and_go"


def test_the_registration_taught_in_the_docs_loads():
    (registration,) = [b for b in blocks(read("docs/conventions.md"), "toml") if "[[trocar]]" in b]
    assert parse_registration(registration, "docs/conventions.md").width_px == 1280


def test_python_in_the_docs_is_python():
    for page in PAGES:
        for block in blocks(page.read_text(encoding="utf-8"), "python"):
            compile(block, page.name, "exec")


def test_reading_a_recording_as_the_docs_say(quick_uri, tmp_path, monkeypatch, capsys):
    from haptigraph.config import load_config

    monkeypatch.chdir(tmp_path)
    settings = (f"source.uri={quick_uri}", "run.realtime=false", "recording.path=run.mcap")
    assemble.build(load_config(None, settings)).run()
    for block in blocks(read("docs/recordings.md"), "python"):
        exec(block, {})
    assert "target_hit" in capsys.readouterr().out


def test_scenarios_stand_in_the_readme():
    for name in scenario_names():
        assert name in read("README.md")


def test_it_is_said_that_this_is_no_medical_device():
    for name in ("README.md", "docs/safety.md"):
        assert "not a medical device" in read(name)
