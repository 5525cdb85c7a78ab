"""Commands that prepare a run: register, check."""

import sys
from typing import Any

import click

from haptigraph.terminal import progress_bar

__all__ = ["check", "register"]


@click.command()
@click.argument("source")
@click.option("-o", "--output", metavar="FILE", required=True, help="The registration to write (TOML).")
@click.option("--target", metavar="X,Y", help="The target, in pixels of the image as stored.")
@click.option("--target-mm", type=float, help="Or from the retina's bottom, to the surgeon's right.  [0]")
@click.option("--trocar", metavar="left|right|X,Y", help="The trocar in use, if no needle moves to show it.")
@click.option("--mirrored/--not-mirrored", default=True, help="Seen through a mirror, or not.  [mirrored]")
@click.option("--diameter-mm", default=24.0, show_default=True, help="Inner diameter of the globe.")
@click.option("--picture", metavar="FILE", help="The PNG to draw; beside the registration if not given.")
@click.option("--images", default=40, show_default=True, help="How many images of SOURCE to use, spread out.")
@click.option("--force", is_flag=True, help="Overwrite files that exist.")
def register(source: str, output: str, picture: str | None, force: bool, **wishes: Any) -> None:
    """Find eye, retina and trocars in SOURCE by itself, and write the registration.

    SOURCE is an image, or what `run` takes but a camera; best a clip in which the needle goes in and turns.
    """
    from haptigraph.analysis.registering import register_source
    from haptigraph.analysis.registration_wishes import Wishes

    with progress_bar() as progress:
        click.echo(register_source(source, output, Wishes(**wishes), picture, force=force, progress=progress))


@click.command()
@click.argument("procedure", default="subretinal_injection")
def check(procedure: str) -> None:
    """Check PROCEDURE and explain it: relations, states by priority, touch."""
    from rich.console import Console
    from rich.text import Text

    from haptigraph.analysis.explanation import explain
    from haptigraph.assemble import load_procedure

    loaded = load_procedure(procedure)
    # No markup: what looks like it is the user's. Where nobody looks, nothing is broken into lines.
    console = Console(markup=False, emoji=False, width=None if sys.stdout.isatty() else 10_000)
    console.print(Text.assemble((loaded.title, "bold"), f"  {loaded.source}\nsha256 {loaded.sha256}"))
    for table in explain(loaded):
        console.print(table)
    console.print("no errors")
