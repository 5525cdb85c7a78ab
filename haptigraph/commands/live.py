"""The command `live`, which shows the loop in a browser."""

from contextlib import closing

import click

from haptigraph.commands.options import page_options, page_token, run_options, run_settings
from haptigraph.commands.running import run_loop
from haptigraph.commands.terminal import print_status, terminable
from haptigraph.errors import NeedsRegistration

__all__ = ["live"]


@click.command()
@run_options
@page_options
@click.option(
    "--recordings", metavar="FOLDER", default=".", help="Recordings to browse; default: the current folder."
)
def live(
    port: int | None, host: str, token: str | None, recordings: str, config: str | None, **given: object
) -> None:
    """Run the loop on SOURCE in real time, and show it on a page in the browser.

    SOURCE is what `run` takes; without one, you steer a simulated needle from the page. Scenarios repeat.
    Open the printed address. If SOURCE needs a registration and none is given, the page lets you create one
    first.
    The page is served to this machine only; with another --host, visitors need the token.
    """
    from functools import partial
    from pathlib import Path

    from msgspec.structs import replace

    from haptigraph.config import load_config
    from haptigraph.dashboard.live.live import LivePage
    from haptigraph.dashboard.server.server import listen
    from haptigraph.errors import BadInput

    if not Path(recordings).is_dir():
        raise BadInput("is no folder; --recordings names the folder of recordings to browse", recordings)
    settings = run_settings(given, realtime=True)
    begin = () if config else ("source.uri=teleop",)
    settled = load_config(config, (*begin, *settings))
    if settled.source.uri.startswith("phantom:"):
        settled = load_config(config, ("source.loop=true", *settings))
    key = page_token(host, token)
    with closing(listen(host, port or 0)) as listener:
        page_of = partial(LivePage, listener=listener, host=host, token=key, recordings=Path(recordings))
        page = page_of(settled)
        try:
            run_loop(settled, page)
            return
        except NeedsRegistration as needed:
            print_status(f"haptigraph: {needed}")
        print_status(f"haptigraph: or create one now; the page is at {page.address}")
        try:
            with terminable():
                made = page.wait_for_registration()
        except KeyboardInterrupt:
            print_status("haptigraph: stopped")
            return
        settled = replace(settled, source=replace(settled.source, registration=made))
        run_loop(settled, page_of(settled))
