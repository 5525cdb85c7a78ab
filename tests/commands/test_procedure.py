"""`haptigraph procedure list` and `procedure new`."""

from importlib import resources

import pytest
from helpers import call, refuse
from paths import GOLDEN

from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.recording.reader import RunReader


def test_list_names_every_shipped_procedure_with_its_title():
    lines = call("procedure", "list").stdout.splitlines()
    for name in procedure_names():
        (line,) = (line for line in lines if line.split()[:1] == [name])
        assert load_procedure(name).title in line
    assert any("procedure new --from" in line for line in lines)


@pytest.mark.parametrize("name", procedure_names())
def test_new_copies_a_procedure_that_runs_as_the_shipped_one(name, tmp_path):
    copy = tmp_path / "my.toml"
    result = call("procedure", "new", "--from", name, "-o", copy)
    assert result.exit_code == 0
    shipped = resources.files("haptigraph.procedures").joinpath(f"{name}.toml")
    assert copy.read_bytes() == shipped.read_bytes()
    assert load_procedure(str(copy)).sha256 == load_procedure(name).sha256
    assert f"haptigraph check {copy}" in result.stdout and f"--procedure {copy}" in result.stdout


def test_new_copies_the_procedure_of_a_recording(tmp_path):
    recording, copy = GOLDEN / "vein_cannulation.mcap", tmp_path / "recorded.toml"
    assert call("procedure", "new", "--from", recording, "-o", copy).exit_code == 0
    assert copy.read_text() == RunReader(recording).info.procedure


def test_new_overwrites_only_with_force(tmp_path):
    mine = tmp_path / "my.toml"
    mine.write_text("mine")
    arguments = ("procedure", "new", "--from", "membrane_peeling", "-o", mine)
    assert refuse(*arguments) == f"haptigraph: {mine}: exists already; --force overwrites it"
    assert mine.read_text() == "mine"
    assert call(*arguments, "--force").exit_code == 0
    assert load_procedure(str(mine)).name == "membrane_peeling"


@pytest.mark.parametrize(
    ("name", "file", "sentence"),
    [
        ("peeling", "my.toml", "unknown procedure 'peeling'"),
        ("membrane_peeling", "my.txt", "my.txt: the name of a procedure's file ends in .toml"),
        ("membrane_peeling", "no/my.toml", "its folder does not exist; create it first"),
    ],
)
def test_what_cannot_be_written_is_one_sentence(name, file, sentence, tmp_path):
    assert sentence in refuse("procedure", "new", "--from", name, "-o", tmp_path / file)
    assert not (tmp_path / file).exists()
