"""Help: examples that can be typed, whole sentences, commands by task; `make help`."""

import re
import shlex
import subprocess

import click
import pytest
from helpers import call
from paths import ROOT

from haptigraph.cli import main


def every_command(group=main, path=()):
    for name, command in group.commands.items():
        yield (*path, name), command
        if isinstance(command, click.Group):
            yield from every_command(command, (*path, name))


COMMANDS = list(every_command())


@pytest.mark.parametrize(
    ("path", "command"), COMMANDS, ids=lambda value: " ".join(value) if isinstance(value, tuple) else ""
)
def test_every_command_has_examples_with_options_that_exist(path, command):
    text = call(*path, "--help").output
    lines = re.findall(r"^ +(haptigraph .*)$", text.partition("Examples:")[2], re.MULTILINE)
    assert lines, text
    assert any(shlex.split(line)[1 : 1 + len(path)] == list(path) for line in lines)
    for line in lines:
        _, *words = shlex.split(line)
        context, used = click.Context(main), main
        while isinstance(used, click.Group) and words and words[0] in used.commands:
            used = used.commands[words.pop(0)]
        known = {
            option
            for parameter in used.get_params(context)
            for option in (*parameter.opts, *parameter.secondary_opts)
        }
        assert {word for word in words if word.startswith("-") and not re.match(r"-\d", word)} <= known, line


@pytest.mark.parametrize(
    "path", [(), *(path for path, command in COMMANDS if isinstance(command, click.Group))]
)
def test_no_sentence_is_cut_off(path):
    assert "..." not in call(*path, "--help").output.replace("[ARGS]...", "").replace(
        "source.lateral_mm_per_px=...", ""
    )


@pytest.mark.parametrize("path", [(), ("robot",), ("study",)])
def test_commands_are_listed_once_by_task(path):
    group = main.commands[path[0]] if path else main
    text = call(*path, "--help").output
    listed = re.findall(r"^  ([a-z][a-z-]+) +[A-Z]", text, re.MULTILINE)
    assert sorted(listed) == sorted(group.commands)
    assert listed != sorted(listed)


def test_the_first_task_is_to_try_it():
    text = call("--help").output
    assert text.index("Try it:") < text.index("  live ") < text.index("  run ") < text.index("  study ")


def test_make_help_lists_every_documented_target():
    shown = subprocess.run(
        ["make", "-C", ROOT, "--no-print-directory", "help"], capture_output=True, text=True, check=True
    ).stdout
    documented = re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert {"help", "live", "demo", "test"} <= set(documented)
    for target in documented:
        assert re.search(rf"^make {target} +\S", shown, re.MULTILINE), target
