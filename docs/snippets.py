"""Every fenced block of a page is executed: `make docs`.

    console   commands after `$ `, in a folder of the page's own; the output shown below them must appear
    python    in one namespace per page, in that folder
    toml      must parse
    diff      lines with - are replaced by lines with + in the file of the last `change`
    text      is shown only

A comment directly above a block says more, several things separated by `;`:

    <!-- file NAME -->         the block is a file of that folder; `append NAME` adds to it
    <!-- change NAME -->       the block is a diff of that file
    <!-- undo NAME -->         the last change of that file is taken back before the block
    <!-- exit CODE -->         the last command ends with that code
    <!-- until TEXT -->        the last command runs until it prints TEXT, then gets Ctrl-C
    <!-- not run: REASON -->   commands are only checked: that they exist, with these options
    <!-- given NAME -->        a stand-in for what a reader has (stand_ins/), for the rest of the page
"""

import ast
import doctest
import json
import os
import re
import shlex
import signal
import subprocess
import threading
import tomllib
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import click
from stand_ins import STAND_INS
from stand_ins.stand_in import ENVIRONMENT
from sybil import Document, Example, Region
from sybil.parsers.markdown.lexers import RawFencedCodeBlockLexer

from haptigraph.cli import main

DIRECTIONS = re.compile(r"<!--\s*([^<>]*?)\s*-->\s*\Z")
WORDS = ("file", "append", "change", "undo", "exit", "until", "not run:", "given")
TIMEOUT_S = 240
"""After which a command is killed, with all processes that it started."""
SHOWN = {
    **ENVIRONMENT,
    "COLUMNS": "100",
    "MPLBACKEND": "agg",
    "BROWSER": "true",  # no browser opens
}

signal.signal(signal.SIGINT, signal.default_int_handler)
"""Also as a job in the background, whose children would ignore Ctrl-C otherwise."""


def parse(document: Document) -> Iterable[Region]:
    """Make an example of every fenced block; those of MyST, in braces, belong to Sphinx."""
    for region in RawFencedCodeBlockLexer(re.compile(r"(?P<language>[\w-]*|\{.*)$\n", re.MULTILINE))(
        document
    ):
        language = region.lexemes["language"]
        if not language.startswith("{"):
            region.parsed = (language, region.lexemes["source"])
            region.evaluator = evaluate
            yield region


def setup(namespace: dict, folder: Path) -> None:
    """Begin a page in an empty folder."""
    namespace.update({"_folder": folder, "_cwd": folder, "_replaced": {}, "_stop": [], "__name__": "page"})


def teardown(namespace: dict) -> None:
    """Stop the stand-ins of a page."""
    for stop in namespace["_stop"]:
        stop()


def evaluate(example: Example) -> str | None:
    """Execute one block; return what is wrong."""
    language, text = example.parsed
    folder: Path = example.namespace["_folder"]
    directions = directions_before(example)
    prepare(example, directions, text)
    if "not run:" in directions:
        return check_commands(text) if language == "console" else None
    match language:
        case "console":
            return run_console(example, text, directions)
        case "python":
            return run_python(example, text)
        case "toml":
            tomllib.loads(text)
        case "json":
            json.loads(text)
        case "diff":
            change(folder / directions["change"], text)
        case "text":
            pass
        case _:
            return (
                f"```{language}: say console, python, toml, json, diff or text, or <!-- not run: REASON -->"
            )
    return None


def prepare(example: Example, directions: dict[str, str], text: str) -> None:
    """Bring stand-ins and files into the state in which a block meets them."""
    folder: Path = example.namespace["_folder"]
    for name in directions.get("given", "").split():
        stand_in = STAND_INS[name](folder)
        example.namespace["_replaced"].update(stand_in.replaced)
        example.namespace["_stop"].append(stand_in.stop)
    if "file" in directions or "append" in directions:
        write(folder / (directions.get("file") or directions["append"]), text, append="append" in directions)
    if "undo" in directions:
        undo(folder / directions["undo"])


def directions_before(example: Example) -> dict[str, str]:
    """Return the directions above a block."""
    comment = DIRECTIONS.search(example.document.text[: example.region.start])
    found = {}
    for direction in comment[1].split(";") if comment else ():
        word = next((word for word in WORDS if direction.strip().startswith(word)), None)
        if word:  # other comments are for people
            found[word] = direction.strip().removeprefix(word).strip()
    return found


def write(path: Path, text: str, *, append: bool) -> None:
    """Write a file that a reader saves."""
    path.parent.mkdir(parents=True, exist_ok=True)
    before = path.read_text(encoding="utf-8") + "\n" if append and path.exists() else ""
    path.write_text(before + text, encoding="utf-8")


def change(path: Path, diff: str) -> None:
    """Replace lines of a file, keeping it as it was beside it."""
    text = path.read_text(encoding="utf-8")
    old, new = ("\n".join(line[1:] for line in diff.splitlines() if line.startswith(sign)) for sign in "-+")
    if old not in text:
        raise AssertionError(f"{path.name} does not contain:\n{old}")
    path.with_name(path.name + ".before").write_text(text, encoding="utf-8")
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def undo(path: Path) -> None:
    """Take the last change of a file back."""
    path.with_name(path.name + ".before").replace(path)


def commands_of(text: str) -> list[tuple[str, str]]:
    """Return commands and the output shown below each."""
    commands: list[tuple[str, str]] = []
    lines = iter(text.splitlines())
    for line in lines:
        if line.startswith("$ "):
            command = line[2:]
            while command.endswith("\\"):
                command = f"{command[:-1]} {next(lines).strip()}"
            commands.append((command, ""))
        elif commands:
            commands[-1] = (commands[-1][0], f"{commands[-1][1]}{line}\n")
        else:
            raise AssertionError(f"a console block begins with `$ `, not {line!r}")
    return commands


def run_console(example: Example, text: str, directions: dict[str, str]) -> str | None:
    """Run commands one after the other; compare codes and output."""
    *others, last = commands_of(text)
    for command, shown in others:
        if wrong := run(example, command, shown, 0, None):
            return wrong
    return run(example, *last, int(directions.get("exit", 0)), directions.get("until"))


def run(example: Example, command: str, shown: str, code: int, until: str | None) -> str | None:
    """Run one command."""
    replaced = example.namespace["_replaced"]
    folder = example.namespace["_folder"]
    for name, real in replaced.items():
        command = command.replace(name, real)
    kept = shlex.quote(str(folder / ".cwd"))  # the command may have left the folder
    process = subprocess.Popen(
        ["bash", "-c", f"{command}\n_code=$?; pwd > {kept}; exit $_code"],
        cwd=example.namespace["_cwd"],
        env=SHOWN,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        encoding="utf-8",
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a background job ignores it
    )
    is_late = threading.Event()
    limit = threading.Timer(TIMEOUT_S, kill, (process, is_late))
    limit.start()
    output = read_until(process, until) if until else process.communicate()[0]
    limit.cancel()
    for name, real in replaced.items():
        output = output.replace(real, name)
    if is_late.is_set():
        what = f"printing {until!r}" if until and until not in output else "ending"
        return f"$ {command}\nwas killed after {TIMEOUT_S} s without {what}:\n{output}"
    if until and until not in output:
        return f"$ {command}\nended with {process.returncode} without printing {until!r}:\n{output}"
    if not until and process.returncode != code:
        return f"$ {command}\nended with {process.returncode}, expected {code}:\n{output}"
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    checker = doctest.OutputChecker()
    if shown.strip() and not checker.check_output(shown, output, flags):
        return f"$ {command}\nshown:\n{shown}\nprinted:\n{output}"
    if (folder / ".cwd").exists():  # not after Ctrl-C
        example.namespace["_cwd"] = (folder / ".cwd").read_text().strip()
    return None


def kill(process: subprocess.Popen[str], is_late: threading.Event) -> None:
    """Kill a command that took too long, with the processes that it started."""
    is_late.set()
    with suppress(ProcessLookupError):  # it ended meanwhile
        os.killpg(process.pid, signal.SIGKILL)


def read_until(process: subprocess.Popen[str], text: str) -> str:
    """Read until a text appears, then interrupt."""
    output = ""
    for line in process.stdout or ():
        output += line
        if text in output:
            break
    os.killpg(process.pid, signal.SIGINT)
    return output + process.communicate()[0]


def run_python(example: Example, text: str) -> str | None:
    """Execute a program in the namespace and the folder of its page."""
    before = Path.cwd()
    os.chdir(example.namespace["_folder"])
    try:
        module = ast.parse("\n" * example.line + text, str(example.path))
        exec(compile(module, str(example.path), "exec"), example.namespace)
    finally:
        os.chdir(before)
    return None


def check_commands(text: str) -> str | None:
    """Check that the commands of haptigraph exist, with these options, without running them."""
    for line, _ in commands_of(text):
        words = shlex.split(line, comments=True)
        if words[:1] != ["haptigraph"]:
            continue
        command: click.Command = main
        context = click.Context(command, info_name="haptigraph")
        rest = words[1:]
        while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
            found = command.get_command(context, rest[0])
            if found is None:
                return f"no command {rest[0]!r} in: {line}"
            command, rest = found, rest[1:]
            context = click.Context(command, parent=context, info_name=command.name)
        known = {name for option in command.params for name in (*option.opts, *option.secondary_opts)} | {
            "--help"
        }
        unknown = [word for word in rest if re.match(r"--?[a-z]", word) and word.split("=")[0] not in known]
        if unknown:
            return f"no option {unknown[0]} in: {line}"
    return None


__all__ = ["parse", "setup", "teardown"]
