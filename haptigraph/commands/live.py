"""The command that shows the loop in a browser: live."""

from contextlib import closing

import click

from haptigraph.commands.options import (
    config_option,
    procedure_option,
    registration_option,
    set_option,
    settings_of,
)
from haptigraph.commands.running import run_loop
from haptigraph.errors import NeedsRegistration
from haptigraph.terminal import tell, terminable

__all__ = ["live"]


@click.command()
@click.argument("source", required=False)
@registration_option
@procedure_option
@click.option("--device", metavar="DEVICE", help="console, or trace:FILE.csv.")
@click.option("--record", metavar="FILE", help="Keep the run in a new MCAP file.")
@click.option("--port", type=click.IntRange(1, 65535), help="Of the page; any free one if not given.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to serve on.")
@click.option("--token", metavar="TOKEN", help="What visitors must know; made up if --host needs one.")
@click.option(
    "--recordings", metavar="FOLDER", default=".", help="Recordings to look at; where you are if not given."
)
@config_option
@set_option
def live(
    source: str | None,
    registration: str | None,
    procedure: str | None,
    device: str | None,
    record: str | None,
    port: int | None,
    host: str,
    token: str | None,
    recordings: str,
    config: str | None,
    settings: tuple[str, ...],
) -> None:
    """Run the loop on SOURCE in real time, with a page to watch it by.

    SOURCE is what `run` takes; without one, you steer a simulated needle from the page. A scenario starts
    again when it is over. Open the printed address. If SOURCE needs a registration and none is given, a page
    to make one comes first.
    The page is for this machine only; with another --host, only for those who know the token.
    """
    import secrets
    from functools import partial
    from pathlib import Path

    from msgspec.structs import replace

    from haptigraph.config import load_config
    from haptigraph.dashboard.door import LOOPBACK
    from haptigraph.dashboard.live import LivePage
    from haptigraph.dashboard.server import listen
    from haptigraph.errors import BadInput

    if not Path(recordings).is_dir():
        raise BadInput("is no folder; --recordings names the folder of recordings to look at", recordings)
    options = {
        "source.uri": source,
        "source.registration": registration,
        "run.procedure": procedure,
        "haptics.device": device,
        "recording.path": record,
        "run.realtime": True,
    }
    begin = () if config else ("source.uri=teleop",)
    settled = load_config(config, (*begin, *settings, *settings_of(options)))
    if settled.source.uri.startswith("phantom:"):
        settled = load_config(config, ("source.loop=true", *settings, *settings_of(options)))
    key = token or ("" if host in LOOPBACK else secrets.token_urlsafe(12))
    with closing(listen(host, port or 0)) as listener:
        page_of = partial(LivePage, listener=listener, host=host, token=key, recordings=Path(recordings))
        page = page_of(settled)
        try:
            run_loop(settled, page)
            return
        except NeedsRegistration as needed:
            tell(f"haptigraph: {needed}")
        tell(f"haptigraph: or make one now: the page is at {page.address}")
        with terminable():
            made = page.registered_first()
        settled = replace(settled, source=replace(settled.source, registration=made))
        run_loop(settled, page_of(settled))
