"""Commands that run the loop in the terminal: run, demo."""

import tempfile
from contextlib import closing, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from haptigraph.commands.help import examples
from haptigraph.commands.options import run_options, run_settings, settings_of
from haptigraph.commands.terminal import print_status, progress_bar, show_page, terminable
from haptigraph.errors import BadInput, HaptigraphError, MissingExtra, NotSilent

if TYPE_CHECKING:
    from haptigraph.analysis.metrics.run import RunMeasures
    from haptigraph.config import Config
    from haptigraph.dashboard.live.live import LivePage
    from haptigraph.inference.procedure import Procedure
    from haptigraph.pipeline import Loop
    from haptigraph.recording.writer import Progress
    from haptigraph.sinks.console import ConsoleSink
    from haptigraph.stages import Sink

__all__ = ["demo", "run", "run_loop"]


@click.command(
    epilog=examples(
        "haptigraph run clip.mp4 --registration eye.toml --record run.mcap",
        "haptigraph run camera:0 --registration eye.toml --device gamepad:0",
        "haptigraph run phantom:wrong_place_then_hit --fast",
        "haptigraph run teleop --force inverse3 --procedure subretinal_injection_force --record run.mcap",
    )
)
@run_options
@click.option(
    "--realtime/--fast", default=None, help="Pace images by the clock, or run as fast as the processor can."
)
def run(config: str | None, realtime: bool | None, **given: object) -> None:
    """Run the loop on SOURCE: images in, haptic feedback out.

    SOURCE is phantom[:SCENARIO], camera:N, realsense[:SERIAL], ros2:TOPIC, rosbag:PATH, or the path of a
    video, a DICOM file, a folder of images or a recording; `haptigraph sources` lists them all. Without one,
    and as `phantom`, it is the simulated operator of the scenario align_then_approach. Options of a source
    are settings: --set source.rate_hz=60. Cameras and the phantom run in real time, files as fast as
    possible unless a device vibrates or a page shows them. If the machine is too slow, the phantom and files
    play slower than real time; the summary says so. Ctrl-C ends the run and prints its summary.
    """
    from haptigraph.config import load_config

    run_loop(load_config(config, run_settings(given, realtime)))


@click.command(
    epilog=examples(
        "haptigraph demo",
        "haptigraph demo --fast --output demo",
    )
)
@click.option(
    "--scenario",
    default="wrong_place_then_hit",
    show_default=True,
    help="Scenario of the simulated operator.",
)
@click.option("--output", metavar="FOLDER", help="For the recording and its figure; default: a new folder.")
@click.option("--realtime/--fast", default=True, help="Run in real time, or as fast as possible.")
def demo(scenario: str, output: str | None, realtime: bool) -> None:
    """Demonstrate the whole loop in half a minute on a simulated eye: run, record, replay, plot.

    The picture needs haptigraph[figures]; everything else works without.
    """
    from haptigraph.analysis.metrics.replay import replay as run_again
    from haptigraph.config import load_config
    from haptigraph.sim.scenario import load_scenario

    load_scenario(scenario)  # a wrong name must not create a folder
    folder = Path(output) if output else Path(tempfile.mkdtemp(prefix="haptigraph-demo-"))
    folder.mkdir(parents=True, exist_ok=True)
    recording, picture = folder / "demo.mcap", folder / "demo.png"
    if picture.exists():
        raise BadInput("exists already; the demo never overwrites a file", picture)
    options = {
        "source.uri": f"phantom:{scenario}",
        "recording.path": str(recording),
        "run.realtime": realtime,
    }
    if not run_loop(load_config(None, settings_of(options))):
        return
    with progress_bar() as progress:
        report = run_again(recording, None, progress)
        drawn = _draw(recording, picture, progress)
    click.echo(f"\nreplayed        {report.identical} of {report.steps} steps identical")
    click.echo(f"recording       {recording}\npicture         {drawn}")


def _draw(recording: Path, picture: Path, progress: "Progress") -> str:
    """Draw a run; return the name of the picture, or why there is none."""
    try:
        from haptigraph.analysis.plots.figures import run_figure
    except MissingExtra as missing:
        return f"not drawn: {missing}"
    run_figure(recording, picture, progress)
    return str(picture)


def run_loop(
    config: "Config",
    page: "LivePage | None" = None,
    *,
    opens_browser: bool = False,
    practice: str | None = None,
) -> bool:
    """Run a configuration and print the summary, also if the run fails; return False if interrupted.

    Args:
        config: The configuration.
        page: The live page, if any; after the run it stays until Ctrl-C.
        opens_browser: Whether to open the page.
        practice: CSV file for the scores of all runs; None: no scores.
    """
    from haptigraph.analysis.metrics.run import RunMeasures
    from haptigraph.analysis.metrics.summary import summary
    from haptigraph.assemble import build, is_realtime, load_procedure
    from haptigraph.sinks.console import ConsoleSink

    procedure = load_procedure(config.run.procedure)
    measures = RunMeasures.under(procedure)
    with terminable(), progress_bar() as progress:
        console = ConsoleSink(shows_time=not is_realtime(config))
        sinks: list[Sink] = [console, page.hub] if page else [console]
        if practice is not None:
            sinks.append(_practice(practice, procedure, page))
        listener = page.hub.record_level if page else None
        with (
            closing(build(config, sinks=sinks, progress=progress, listener=listener)) as loop,
            page.served(loop, measures) if page else nullcontext(),
        ):
            if page:
                show_page(page, opens=opens_browser)
            for note in loop.notes:
                print_status(note)
            failure = _run_to_end(loop, measures, console)
            if loop.report.steps or failure is None:
                click.echo(f"\n{summary(measures, loop.report)}")
            if config.recording.path and loop.report.steps:
                click.echo(f"recording       {config.recording.path}")
            if page:
                _end_page(page, str(failure or loop.report.ended))
    if isinstance(failure, BadInput) and not failure.file:
        failure = BadInput(failure.problem, config.source.uri, failure.place)
    _raise_last(
        HaptigraphError(loop.report.incomplete) if loop.report.incomplete else None,
        failure,
        None if loop.report.is_silent else NotSilent(config.haptics.outputs),
    )
    return loop.report.ended != "interrupted"


def _practice(path: str, procedure: "Procedure", page: "LivePage | None") -> "Sink":
    """Return a sink that scores runs, in the terminal and on the page."""
    from datetime import UTC, datetime

    from haptigraph.analysis.metrics.practice import Practice

    def report(sentence: str) -> None:
        print_status(sentence)
        if page:
            page.hub.publish_threadsafe("score", text=sentence)

    return Practice(path, procedure, lambda: datetime.now(UTC), report)


def _raise_last(*problems: HaptigraphError | None) -> None:
    """Raise the last problem, if any, after printing those before it."""
    raised = [problem for problem in problems if problem is not None]
    for problem in raised[:-1]:
        print_status(f"haptigraph: {problem}")
    if raised:
        raise raised[-1]


def _run_to_end(loop: "Loop", measures: "RunMeasures", console: "ConsoleSink") -> HaptigraphError | None:
    """Run a loop until its source, the user or an error ends it; return the error."""
    try:
        with closing(loop.steps()) as steps:
            for step in steps:
                measures.add(step)
                for claim in measures.just_broken:
                    time_s = (step.stamp_ns - measures.first_ns) / 1e9
                    console.print_line(f"{time_s:7.2f} s  ! violated: {claim}")
    except KeyboardInterrupt:
        loop.report.ended = "interrupted"
    except HaptigraphError as error:
        loop.report.ended = "failed"
        return error
    return None


def _end_page(page: "LivePage", ended: str) -> None:
    """Show viewers how the run ended; after the end of a file the page stays until Ctrl-C."""
    stays = ended == "source ended"
    with suppress(KeyboardInterrupt):  # the user may press Ctrl-C as soon as the page shows the end
        if stays:
            print_status("haptigraph: the source has ended; the page stays until Ctrl-C")
        page.end(ended)
        if stays:
            page.wait()
