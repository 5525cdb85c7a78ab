"""Commands for procedures as files: procedure list, procedure new."""

import click

from haptigraph.errors import BadInput, unknown_name

__all__ = ["new", "procedure"]


@click.group()
def procedure() -> None:
    """List the shipped procedures, or copy one to edit.

    A procedure is a TOML file with rules and haptic patterns; docs/procedures.md explains every key.
    """


@procedure.command("list")
def list_() -> None:
    """List the procedures that ship with haptigraph."""
    from haptigraph.assemble import load_procedure, procedure_names

    names = procedure_names()
    width = max(map(len, names))
    for name in names:
        loaded = load_procedure(name)
        click.echo(f"{name:{width}}  {loaded.title}, {len(loaded.states)} states")
    click.echo("\nCopy one to edit: haptigraph procedure new --from NAME -o my.toml")


@procedure.command()
@click.option("--from", "name", metavar="NAME", required=True, help="Shipped procedure to copy.")
@click.option("-o", "--output", metavar="FILE", required=True, help="TOML file to write.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def new(name: str, output: str, force: bool) -> None:
    """Copy a shipped procedure to a file of your own.

    \b
    Example:
      haptigraph procedure new --from subretinal_injection -o my.toml
      haptigraph check my.toml
      haptigraph live --procedure my.toml
    """
    from importlib import resources
    from pathlib import Path

    from haptigraph.assemble import procedure_names

    if name not in procedure_names():
        raise BadInput(unknown_name("procedure", name, procedure_names()))
    path = Path(output)
    if path.suffix != ".toml":
        raise BadInput("the name of a procedure's file ends in .toml", path)
    if not path.parent.is_dir():
        raise BadInput("its folder does not exist; create it first", path)
    text = resources.files("haptigraph.procedures").joinpath(f"{name}.toml").read_bytes()
    try:
        with path.open("wb" if force else "xb") as file:
            file.write(text)
    except FileExistsError:
        raise BadInput("exists already; --force overwrites it", path) from None
    click.echo(f"{path} was written; edit it, then prove it and run it:")
    click.echo(f"  haptigraph check {path}\n  haptigraph live --procedure {path}")
