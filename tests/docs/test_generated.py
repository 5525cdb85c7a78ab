"""The pages' lists of commands and settings are complete."""

import re
from pathlib import Path

import click
import pytest
from paths import ROOT

pytest.importorskip("sphinx", reason="needs the packages of `make docs`")

from generated import PARTS, citation, commands, settings

import haptigraph
from haptigraph.cli import main
from haptigraph.config import Config


def test_every_setting_has_its_default_and_meaning():
    text = settings()
    for table in Config.__struct_fields__:
        for key in getattr(Config(), table).__struct_fields__:
            assert re.search(rf"^`{table}\.{key}` \(default .+\)\n: .+", text, re.MULTILINE)
    assert "`haptics.deadman_ms` (default `150`, ms, above 0, at most 1,000)" in text


def test_every_command_has_its_options_and_examples():
    text = commands()

    def check(command: click.Command, path: str) -> None:
        assert re.search(rf"^###? {path}$", text, re.MULTILINE), path
        assert f"](#{path.replace(' ', '-')}) |" in text
        for option in command.params:
            if isinstance(option, click.Option):
                assert option.opts[-1] in text
        for name, part in getattr(command, "commands", {}).items():
            check(part, f"{path} {name}")

    for name, command in main.commands.items():
        check(command, f"haptigraph {name}")
    assert "$ haptigraph live camera:0" in text


def test_links_of_the_lists_exist():
    for name in ("commands", "settings"):
        for page in re.findall(r"\]\((\.\./[^)#]+)", PARTS[name]()):
            assert (ROOT / "docs" / "reference" / Path(page)).exists(), page


def test_the_citation_is_that_of_the_repository():
    assert "author    = {Arbabi, Danial and " in citation()


def test_every_public_name_is_on_a_page():
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs/reference/api").glob("*.md"))
    for name in set(haptigraph.__all__) - {"__version__"}:
        assert re.search(rf"^\.\. auto\w+:: haptigraph\.(\w+\.)*{name}$", pages, re.MULTILINE), name
