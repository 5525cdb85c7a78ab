"""Parts of pages that the software states: commands, settings, how to cite it. Sphinx puts them in.

A page has `<!-- generated: NAME -->` where the part belongs.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import msgspec
import yaml
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

from haptigraph.cli import main
from haptigraph.commands.help import TaskGroup
from haptigraph.config import Config

ROOT = Path(__file__).parents[1]
UNITS = {"deg": "°", "grey": "grey levels", "hz": "Hz", "mm": "mm", "ms": "ms", "px": "px"}
BOUNDS = {"ge": "at least", "gt": "above", "le": "at most", "lt": "below"}
BAR = r"\|"
MARKER = re.compile(r"<!-- generated: ([a-z ]+) -->")
PAGE = re.compile(r"docs/(?P<path>(?:explanation|how_to|reference|tutorials)/(?P<name>\w+)\.md(?:#[\w-]+)?)")


def commands() -> str:
    """Return every command: first all in one line each, by task, then each with options and examples."""
    groups = {name: group for name, group in main.commands.items() if isinstance(group, click.Group)}
    parts = [_overview(main, "haptigraph")]
    for name in main.list_commands(_context(main, "haptigraph")):
        parts.append(_command(main.commands[name], f"haptigraph {name}"))
        if name in groups:
            group = groups[name]
            parts += [
                _command(group.commands[part], f"haptigraph {name} {part}")
                for part in group.list_commands(_context(group, name))
            ]
    return "\n".join(parts)


def _context(command: click.Command, name: str) -> click.Context:
    return click.Context(command, info_name=name)


def _overview(group: click.Group, path: str) -> str:
    """Return the commands of a group and of the groups in it, one a row."""
    tasks = group.tasks if isinstance(group, TaskGroup) else {"": tuple(group.commands)}
    lines = []
    for task, names in tasks.items():
        lines += [f"\n**{task}**\n" if task else "", "| `haptigraph` | |", "|---|---|"]
        for name in names:
            lines += _rows(group.commands[name], f"{path} {name}")
    return "\n".join(lines) + "\n"


def _rows(command: click.Command, path: str) -> Iterator[str]:
    name, anchor = path.removeprefix("haptigraph "), path.replace(" ", "-")
    yield f"| [`{name}`](#{anchor}) | {_inline(command.get_short_help_str(1000))} |"
    if isinstance(command, click.Group):
        for name in command.list_commands(_context(command, path)):
            yield from _rows(command.commands[name], f"{path} {name}")


def _command(command: click.Command, path: str) -> str:
    """Return the section of one command."""
    context = _context(command, path)
    usage = " ".join([path, *command.collect_usage_pieces(context)])
    depth = "###" if path.count(" ") > 1 else "##"
    lines = [f"{depth} {path}\n", *_prose(command.help or ""), "", f"```text\n{usage}\n```", ""]
    records = [
        record
        for option in command.get_params(context)
        if isinstance(option, click.Option) and "--help" not in option.opts
        if (record := option.get_help_record(context))
    ]
    if records:
        lines += ["| option | |", "|---|---|"]
        lines += [f"| `{names.replace('|', BAR)}` | {_inline(text)} |" for names, text in records]
    shown = [line.strip() for line in (command.epilog or "").splitlines() if line.startswith("  ")]
    if shown:
        lines += ["", "```console", *(f"$ {line}" for line in shown), "```"]
    return "\n".join(lines) + "\n"


def _prose(text: str) -> Iterator[str]:
    """Yield the paragraphs of a help text; those after a backspace keep their lines."""
    for paragraph in re.split(r"\n\s*\n", text.replace("\f", "").strip()):
        kept = paragraph.removeprefix("\b\n")
        yield f"```text\n{kept}\n```\n" if kept != paragraph else f"{_inline(paragraph)}\n"


def _inline(text: str) -> str:
    """Return a sentence as Markdown: pages become links, placeholders and globs stay as they are."""
    parts = re.split(r"(`[^`]*`|docs/\w+/\w+\.md[#\w-]*)", " ".join(text.split()))
    parts[::2] = [re.sub(r"([<>*\[\]_|])", r"\\\1", part) for part in parts[::2]]
    parts[1::2] = [PAGE.sub(_link, part) for part in parts[1::2]]
    return "".join(parts)


def _link(found: re.Match[str]) -> str:
    return f"[{found['name'].replace('_', ' ')}](../{found['path']})"


def settings() -> str:
    """Return every setting by its table: name, default, unit and range, meaning.

    Raises:
        KeyError: If a setting has no docstring.
    """
    said = ModuleAnalyzer.for_module("haptigraph.config").find_attr_docs()
    parts = []
    for table in msgspec.structs.fields(Config):
        struct: Any = table.type
        parts.append(f"## `[{table.name}]`\n\n{_inline(struct.__doc__)}\n")
        for field in msgspec.structs.fields(struct):
            about = ", ".join(filter(None, [f"default {_default(field.default)}", _range(field)]))
            meaning = _inline(" ".join(said[(struct.__name__, field.name)]))
            parts.append(f"`{table.name}.{field.name}` ({about})\n: {meaning}\n")
    return "\n".join(parts)


def _default(value: object) -> str:
    if value is None:
        return "unset"
    if value in ("", ()):
        return "empty"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"`{text.lower() if isinstance(value, bool) else text}`"


def _range(field: Any) -> str:
    """Return the unit of a setting, and what it accepts."""
    unit = "mm/px" if field.name.endswith("_mm_per_px") else UNITS.get(field.name.rpartition("_")[2], "")
    kind = msgspec.inspect.type_info(field.type)
    if isinstance(kind, msgspec.inspect.UnionType):
        (kind,) = [one for one in kind.types if not isinstance(one, msgspec.inspect.NoneType)]
    if isinstance(kind, msgspec.inspect.LiteralType):
        return ", ".join(filter(None, [unit, " or ".join(f"`{value}`" for value in kind.values)]))
    found = {key: getattr(kind, key, None) for key in BOUNDS}
    bounds = [f"{BOUNDS[key]} {bound:,}" for key, bound in found.items() if bound is not None]
    if found["ge"] is not None and found["le"] is not None:
        bounds = [f"{found['ge']:,} to {found['le']:,}"]
    return ", ".join(filter(None, [unit, *bounds]))


def citation() -> str:
    """Return the entry of CITATION.cff for BibTeX."""
    paper = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["preferred-citation"]
    authors = " and ".join(f"{each['family-names']}, {each['given-names']}" for each in paper["authors"])
    return f"""```text
@inproceedings{{{paper["authors"][0]["family-names"].lower()}{paper["year"]},
  title     = {{{{{paper["title"]}}}}},
  author    = {{{authors}}},
  year      = {{{paper["year"]}}},
  publisher = {{{paper["publisher"]["name"]}}}
}}
```"""


PARTS: dict[str, Callable[[], str]] = {"citation": citation, "commands": commands, "settings": settings}


def setup(app: Sphinx) -> dict[str, bool]:
    """Put the parts into the pages when they are read."""

    def put_in(_app: Sphinx, _name: str, text: list[str]) -> None:
        text[0] = MARKER.sub(lambda found: PARTS[found[1]](), text[0])

    app.connect("source-read", put_in)
    return {"parallel_read_safe": True}
