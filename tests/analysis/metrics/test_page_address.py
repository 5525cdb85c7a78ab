"""Addresses of moments on the recordings page."""

import pytest

from haptigraph.analysis.metrics.page_address import moment_address, page_procedure


@pytest.mark.parametrize(
    ("given", "address"),
    [
        ({"name": "run.mcap"}, "http://127.0.0.1:8765/recordings#run.mcap"),
        ({"name": "P 1/a?b.mcap", "step": 3}, "http://127.0.0.1:8765/recordings#P%201%2Fa%3Fb.mcap?step=3"),
        (
            {"name": "r.mcap", "step": 0, "procedure": "wide.toml", "page": "http://lab:1/"},
            "http://lab:1/recordings#r.mcap?step=0&with=wide.toml",
        ),
    ],
)
def test_names_are_quoted_and_what_follows_is_a_query(given, address):
    assert moment_address(**given) == address


def test_the_page_knows_shipped_procedures_and_files_in_its_folder_or_copies_of_them(tmp_path):
    assert page_procedure("subretinal_injection", tmp_path) == "subretinal_injection"
    assert page_procedure(str(tmp_path / "wide.toml"), tmp_path) == "wide.toml"
    assert page_procedure(str(tmp_path / "elsewhere" / "wide.toml"), tmp_path) == ""
    original = tmp_path / "elsewhere" / "wide.toml"
    original.parent.mkdir()
    original.write_text("wide")
    (tmp_path / "wide.toml").write_text("narrow")
    assert page_procedure(str(original), tmp_path) == ""
    (tmp_path / "wide.toml").write_text("wide")
    assert page_procedure(str(original), tmp_path) == "wide.toml"
