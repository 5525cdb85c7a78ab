"""The command that tells what there is to run on: sources."""

import click

__all__ = ["sources"]


@click.command()
def sources() -> None:
    """List what SOURCE may be, and the cameras that are plugged in.

    Cameras are asked for a size and a rate by settings: --set source.rate_hz=60 --set source.width_px=640
    --set source.height_px=480 --set source.fourcc=YUYV. Without them: the registered size, 30, MJPG.
    """
    from haptigraph.sources.present import kinds, present_cameras

    listed = kinds()
    width = max(len(kind.spelled) for kind in listed)
    for kind in listed:
        lacks = f"; needs: pip install 'haptigraph[{kind.lacks}]'" if kind.lacks else ""
        click.echo(f"{kind.spelled:{width}}  {kind.says}{lacks}")
    cameras = present_cameras()
    click.echo("\nplugged in now" if cameras else "\nno camera is plugged in")
    for uri, name in cameras:
        click.echo(f"{uri:{width}}  {name}")
