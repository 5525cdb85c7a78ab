"""The command that runs a study with people from pages in the browser: study run."""

import platform
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.commands.options import (
    config_option,
    page_options,
    page_tokens,
    profile_option,
    run_settings,
    set_option,
)
from haptigraph.commands.study import STORE, folder_argument, store_option
from haptigraph.commands.terminal import print_status, terminable
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from haptigraph.config import Config
    from haptigraph.study.protocol import Protocol

__all__ = ["study_run"]

MAX_NAME_LENGTH = 80


@click.command(
    "run",
    epilog=examples(
        "haptigraph study run my-study",
        "haptigraph study run my-study --source camera:0 --registration eye.toml --device gamepad:0",
    ),
)
@folder_argument
@store_option
@click.option("--station", metavar="NAME", help="This station's name; this machine's if not given.")
@click.option(
    "--source", metavar="SOURCE", help="Source of images, as for `run`; a simulated eye if not given."
)
@click.option("--registration", metavar="FILE", help="Registration of the anatomy in the images (TOML).")
@click.option("--device", metavar="DEVICE", help="Haptic device, in addition to the participant's page.")
@profile_option
@click.option(
    "--bridge", multiple=True, metavar="BRIDGE", help="Publish live, as for `run`; may be repeated."
)
@config_option
@set_option
@page_options
def study_run(
    folder: str,
    store: str | None,
    station: str | None,
    port: int | None,
    host: str,
    token: str | None,
    config: str | None,
    **given: object,
) -> None:
    """Run a study with participants, from two pages.

    One page is for the experimenter, one for the participant; open each on its own screen. Trials run here
    and are recorded in the study's folder. Started again after a crash, it resumes where it stopped.
    """
    from haptigraph.config import load_config
    from haptigraph.dashboard.server.addresses import address_lines
    from haptigraph.dashboard.server.server import listen
    from haptigraph.study.protocol import load_protocol
    from haptigraph.study.store import Store  # first, as it names the missing extra

    protocol = load_protocol(folder)
    name = (station if station is not None else platform.node() or "station").strip()
    if not 0 < len(name) <= MAX_NAME_LENGTH:
        raise BadInput(f"--station {name[:90]!r}: a name has 1 to {MAX_NAME_LENGTH} characters")
    defaults = () if config else ("source.uri=teleop",)
    base = load_config(config, (*defaults, *run_settings({**given, "procedure": None, "record": None}, True)))
    _check_setup(base, protocol)
    from haptigraph.dashboard.study.service import StudyService
    from haptigraph.dashboard.study.site import StudySite
    from haptigraph.dashboard.study.trial import run_trials
    from haptigraph.study.roster import study_in

    with (
        terminable(),
        closing(listen(host, port or 0)) as listener,
        closing(Store(store or str(protocol.folder / STORE))) as opened,
    ):
        stored = study_in(opened, protocol)
        stored.check_frozen()
        service = StudyService(Path(folder), stored, name, base.haptics)
        site = StudySite(service, base, listener, host=host, token=page_tokens(host, token).steer)
        with site.served():
            print_status(
                f"haptigraph: study {stored.name}{' (simulated)' * stored.simulated}, station {name}"
            )
            for line in address_lines(site.addresses(), "the page is at", " for the experimenter"):
                print_status(line)
            for line in address_lines(site.addresses("/participant"), "and at", " for the participant"):
                print_status(line)
            print_status("haptigraph: Ctrl-C ends both")
            try:
                run_trials(service, site, base, print_status)
            except KeyboardInterrupt:
                print_status("haptigraph: stopped")
            finally:
                service.close()


def _check_setup(base: "Config", protocol: "Protocol") -> None:
    """Open source and device once, and locate all targets, to detect problems before a participant comes."""
    from msgspec.structs import replace

    from haptigraph.assemble import build
    from haptigraph.registration.assumed import assumed_text, needs_consent
    from haptigraph.registration.loading import load_registration
    from haptigraph.registration.retarget import with_target

    for target in protocol.targets if base.source.registration else ():
        registration = with_target(load_registration(base.source.registration), target.along_mm)
        if needs_consent(registration.assumed):
            problem = f"assumes {assumed_text(registration.assumed)}; a study needs measured positions"
            raise BadInput(problem, base.source.registration)
    source = replace(base.source, target_mm=protocol.targets[0].along_mm)
    procedure = protocol.procedure_path(protocol.conditions[0])
    build(replace(base, source=source, run=replace(base.run, procedure=procedure))).close()
