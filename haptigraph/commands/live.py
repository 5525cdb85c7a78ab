"""The command `live`, which shows the loop in a browser."""

from contextlib import closing

import click

from haptigraph.commands.help import examples
from haptigraph.commands.options import page_options, page_tokens, run_options, run_settings
from haptigraph.commands.robots.robot import SAFETY
from haptigraph.commands.running import run_loop
from haptigraph.commands.terminal import print_status, show_page, terminable
from haptigraph.errors import NeedsRegistration

__all__ = ["live"]


@click.command(
    epilog=examples(
        "haptigraph live",
        "haptigraph live clip.mp4 --registration eye.toml",
        "haptigraph live camera:0 --registration eye.toml --record run.mcap",
        "haptigraph live --host 0.0.0.0",
        "haptigraph live --recordings runs",
        "haptigraph live --practice my-scores.csv",
        "haptigraph live --leader gamepad:0",
        "haptigraph live --force inverse3 --procedure subretinal_injection_force",
        "haptigraph live camera:0 --registration eye.toml --robot crtk:PSM1 --robot-setup robot.toml --steer",
    )
)
@run_options
@page_options
@click.option("--browser/--no-browser", default=True, help="Open the page, if this machine has a display.")
@click.option("--practice", metavar="FILE", help="Score every run, from entry to hit, into a CSV file.")
@click.option("--recordings", metavar="FOLDER", help="Recordings to browse; default: the current folder.")
@click.option(
    "--steer", is_flag=True, help="Steer --robot from the page; only from a browser on this machine."
)
@click.option("--home", is_flag=True, help="Enable and home --robot first: it may move by itself.")
@click.option("--allow-remote-motion", is_flag=True, help="Let pages on other machines steer --robot, too.")
def live(
    port: int | None,
    host: str,
    token: str | None,
    browser: bool,
    practice: str | None,
    recordings: str | None,
    steer: bool,
    home: bool,
    allow_remote_motion: bool,
    config: str | None,
    **given: object,
) -> None:
    """Run the loop on SOURCE in real time, and show it on a page in the browser.

    SOURCE is what `run` takes; without one, you steer a simulated needle from the page. Scenarios repeat. To
    look at recordings, give --recordings alone: the address of their page is printed.
    If SOURCE needs a registration and none is given, the page lets you create one first.
    The page is served to this machine only. With another --host two addresses are printed, to steer and to
    watch.

    With --steer the page moves a real robot, while its enable switch is on and the dead-man is held. Research
    software, not a medical device: keep the robot's own emergency stop at hand.
    """
    from functools import partial
    from pathlib import Path

    from msgspec.structs import replace

    from haptigraph.config import load_config
    from haptigraph.dashboard.live.live import LivePage
    from haptigraph.dashboard.server.server import listen
    from haptigraph.errors import BadInput

    folder = Path(recordings or ".")
    if not folder.is_dir():
        raise BadInput("is no folder; --recordings names the folder of recordings to browse", folder)
    settings = run_settings(given, realtime=True)
    begin = () if config else ("source.uri=teleop",)
    settled = load_config(config, (*begin, *settings))
    if settled.source.uri.partition(":")[0] == "phantom":
        settled = load_config(config, ("source.loop=true", *settings))
    tokens = page_tokens(host, token)
    if steer:
        settled = replace(settled, robot=replace(settled.robot, steer=True))
    if settled.robot.steer:
        print_status(f"haptigraph: {SAFETY}")
    elif home or allow_remote_motion:
        raise BadInput("--home and --allow-remote-motion go with --steer")
    with closing(listen(host, port or 0)) as listener:
        page_of = partial(
            LivePage,
            listener=listener,
            host=host,
            tokens=tokens,
            recordings=folder,
            allows_remote_motion=allow_remote_motion,
            homes=home,
        )
        page = page_of(settled)
        if recordings and not (config or given["source"]):
            print_status(
                f"haptigraph: the recordings are at {page.recordings_address}; "
                "the page Live has a simulated eye, which may wait"
            )
        try:
            run_loop(settled, page, opens_browser=browser, practice=practice)
            return
        except NeedsRegistration as needed:
            print_status(f"haptigraph: {needed}")
        print_status("haptigraph: or create one now, on the page")
        show_page(page, opens=browser)
        try:
            with terminable():
                made = page.wait_for_registration()
        except KeyboardInterrupt:
            print_status("haptigraph: stopped")
            return
        settled = replace(settled, source=replace(settled.source, registration=made))
        run_loop(settled, page_of(settled), practice=practice)
