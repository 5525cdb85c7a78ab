"""The command `sources`."""

import click

from haptigraph.commands.help import examples

__all__ = ["sources"]


@click.command(epilog=examples("haptigraph sources"))
def sources() -> None:
    """List the kinds of SOURCE, the simulated scenarios, and the connected cameras.

    Settings choose a camera's size, rate and format: --set source.rate_hz=60 --set source.width_px=640
    --set source.height_px=480 --set source.fourcc=YUYV. The defaults are the registered size, 30 and MJPG.
    """
    from haptigraph.sim.scenario import scenario_document, scenario_names
    from haptigraph.sources.available import connected_cameras, source_kinds

    kinds = source_kinds()
    width = max(len(kind.syntax) for kind in kinds)
    for kind in kinds:
        needs = f"; needs: pip install 'haptigraph[{kind.missing_extra}]'" if kind.missing_extra else ""
        click.echo(f"{kind.syntax:{width}}  {kind.description}{needs}")
    click.echo("\nscenarios, as in phantom:wrong_place_then_hit")
    for name in scenario_names():
        click.echo(f"{name:{width}}  {scenario_document(name).data['scenario']['description']}")
    cameras = connected_cameras()
    click.echo("\nconnected cameras" if cameras else "\nno camera is connected")
    for uri, name in cameras:
        click.echo(f"{uri:{width}}  {name}")
