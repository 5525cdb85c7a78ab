"""The commands. Each parses, assembles and calls; everything heavy is imported when a command needs it."""

import sys
import tempfile
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import haptigraph
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.terminal import progress_bar, tell, terminable

if TYPE_CHECKING:
    from haptigraph.config import Config

__all__ = ["main"]


class Commands(click.Group):
    """A group whose commands end with one sentence and exit code 2 on an error the user can mend."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the chosen command."""
        try:
            return super().invoke(ctx)
        except HaptigraphError as error:
            tell(f"haptigraph: {error}")
            ctx.exit(2)
        except BrokenPipeError:
            raise  # whoever read the output has seen enough; click ends quietly
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            tell(f"haptigraph: {where}{error.strerror or error}")
            ctx.exit(2)
        except KeyboardInterrupt:
            tell("haptigraph: stopped")
            ctx.exit(130)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(haptigraph.__version__, prog_name="haptigraph")
def main() -> None:
    """Turn pictures of an instrument inside the eye into touch.

    Research software, not a medical device.
    """


registration_option = click.option(
    "--registration", metavar="FILE", help="Where the anatomy lies in the images (TOML)."
)
procedure_option = click.option(
    "--procedure", metavar="NAME|FILE", help="Rules and touch; subretinal_injection if not given."
)
config_option = click.option("--config", metavar="FILE", help="Settings (TOML).")
set_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="One setting, e.g. perception.alpha=1; may be repeated.",
)


@main.command()
@click.argument("source", required=False)
@registration_option
@procedure_option
@click.option("--device", metavar="DEVICE", help="console, or trace:FILE.csv.")
@click.option("--record", metavar="FILE", help="Keep the run in a new MCAP file.")
@click.option("--realtime/--fast", default=None, help="Pace images by the clock, or go as fast as possible.")
@config_option
@set_option
def run(
    source: str | None,
    registration: str | None,
    procedure: str | None,
    device: str | None,
    record: str | None,
    realtime: bool | None,
    config: str | None,
    settings: tuple[str, ...],
) -> None:
    """Run the loop on SOURCE: image in, touch out.

    SOURCE is phantom:SCENARIO, camera:N, or the path of a video, a folder of images or a recording. Cameras
    and the phantom run in real time, files as fast as possible. Ctrl-C ends the run with its summary.
    """
    from haptigraph.config import load_config

    options = {
        "source.uri": source,
        "source.registration": registration,
        "run.procedure": procedure,
        "haptics.device": device,
        "recording.path": record,
        "run.realtime": realtime,
    }
    _run(load_config(config, (*settings, *_settings(options))))


@main.command()
@click.argument("recording")
@procedure_option
def replay(recording: str, procedure: str | None) -> None:
    """Run RECORDING again and compare every step.

    With --procedure: what would have happened under another procedure. Without: exit code 1 if steps differ.
    """
    from haptigraph.analysis.replay import replay as run_again
    from haptigraph.analysis.summary import summary

    with progress_bar() as progress:
        report = run_again(recording, procedure, progress)
    if report.is_being_written:
        click.echo("the recording is still being written; this is what there is so far")
    elif not report.is_whole:
        click.echo("the recording was interrupted; `haptigraph recover` makes it whole")
    if report.dropped_images:
        click.echo(f"{report.dropped_images} images were not recorded; steps that depend on them differ")
    click.echo(f"{report.identical} of {report.steps} steps identical")
    if report.first is not None:
        first = report.first
        click.echo(f"first difference: step {first.step} at {first.time_s:.2f} s, {first.message}")
        click.echo(f"  recorded  {first.recorded}\n  replayed  {first.replayed}")
    if procedure:
        click.echo(f"\nas recorded\n{summary(report.recorded)}\n\nas {procedure}\n{summary(report.replayed)}")
    elif report.identical < report.steps:
        sys.exit(1)


@main.command()
@click.argument("clip_dir", required=False)
@click.option(
    "--simulated", type=click.IntRange(min=1), metavar="N", help="Score N random simulated scenes instead."
)
@click.option("--perceiver", metavar="NAME", help="Which perceiver to score; simulated: all if not given.")
@click.option("--seed", type=click.IntRange(min=0), help="Of the simulated scenes.")
@click.option("--figure", metavar="FILE", help="Draw the simulated scenes' errors: PNG, SVG or PDF.")
@procedure_option
@config_option
@set_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def evaluate(
    clip_dir: str | None,
    simulated: int | None,
    perceiver: str | None,
    seed: int | None,
    figure: str | None,
    procedure: str | None,
    config: str | None,
    settings: tuple[str, ...],
    as_json: bool,
) -> None:
    """Score perception and states on a labelled clip, or on simulated scenes.

    CLIP_DIR holds clip.mp4, registration.toml and truth.csv. With --simulated there is no moving average
    (perception.alpha=1) unless --set says so.
    """
    import msgspec

    from haptigraph.config import load_config

    given = (*settings, *_settings({"perception.perceiver": perceiver, "run.procedure": procedure}))
    if (clip_dir is None) == (simulated is None):
        raise BadInput("evaluate takes either CLIP_DIR or --simulated N")
    if clip_dir is not None and (seed is not None or figure is not None):
        raise BadInput("--seed and --figure go with --simulated N")
    with progress_bar() as progress:
        if clip_dir is not None:
            from haptigraph.analysis.evaluation_report import report_clip

            report = report_clip(clip_dir, load_config(config, given), progress)
        else:
            from haptigraph.analysis.accuracy import report_simulated

            settled = load_config(config, ("perception.alpha=1", *given))
            report = report_simulated(
                simulated or 0, perceiver, settled, seed=seed or 0, figure=figure, progress=progress
            )
    click.echo(msgspec.json.encode(report.scores).decode() if as_json else report.text)


@main.command()
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


@main.command()
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


@main.command()
@click.argument("recording")
def recover(recording: str) -> None:
    """Make an interrupted RECORDING whole, in its place."""
    from haptigraph.recording.reader import RunReader
    from haptigraph.recording.writer import recover as make_whole

    reader = RunReader(recording)
    with progress_bar() as progress:
        was_interrupted = make_whole(reader.path, progress)
    steps, _ = RunReader(recording).count()  # reads all of it, and tells damage
    click.echo(f"{recording} is whole" + (f" again: {steps} complete steps" if was_interrupted else ""))


@main.command()
@click.option("--scenario", default="wrong_place_then_hit", show_default=True, help="What the operator does.")
@click.option(
    "--output", metavar="FOLDER", help="Where to put recording and picture; a new folder if not given."
)
@click.option("--realtime/--fast", default=True, help="In real time, or as fast as possible.")
def demo(scenario: str, output: str | None, realtime: bool) -> None:
    """See the whole loop in half a minute: simulated eye, needle, operator; recorded, replayed, drawn."""
    from haptigraph.analysis.figures import run_figure
    from haptigraph.analysis.replay import replay as run_again
    from haptigraph.config import load_config
    from haptigraph.sim.scenario import load_scenario

    load_scenario(scenario)  # so that a wrong name leaves no folder behind
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
    if not _run(load_config(None, _settings(options))):
        return
    with progress_bar() as progress:
        report = run_again(recording, None, progress)
        run_figure(recording, picture, progress)
    click.echo(f"\nreplayed        {report.identical} of {report.steps} steps identical")
    click.echo(f"recording       {recording}\npicture         {picture}")


def _run(config: "Config") -> bool:
    """Run a configuration and print the summary, also of a run that fails; False if it was interrupted."""
    from haptigraph.analysis.measures import RunMeasures
    from haptigraph.analysis.summary import summary
    from haptigraph.assemble import build, is_realtime, load_procedure
    from haptigraph.sinks.console import ConsoleSink

    measures, failure = RunMeasures.under(load_procedure(config.run.procedure).schema), None
    with terminable(), progress_bar() as progress:
        console = ConsoleSink(shows_time=not is_realtime(config))
        with closing(build(config, sinks=[console], progress=progress)) as loop:
            for note in loop.notes:
                tell(f"{config.haptics.device}: {note}")
            try:
                with closing(loop.steps()) as steps:
                    for step in steps:
                        measures.add(step)
            except KeyboardInterrupt:
                loop.report.ended = "interrupted"
            except HaptigraphError as error:
                loop.report.ended, failure = "failed", error
    if loop.report.steps or failure is None:
        click.echo(f"\n{summary(measures, loop.report)}")
    if config.recording.path and loop.report.steps:
        click.echo(f"recording       {config.recording.path}")
    if isinstance(failure, BadInput) and not failure.file:
        raise BadInput(failure.problem, config.source.uri, failure.place)
    if failure is not None:
        raise failure
    return loop.report.ended != "interrupted"


def _settings(options: Mapping[str, object]) -> tuple[str, ...]:
    """Turn command-line options into settings; a text is quoted as TOML so that it stays a text."""
    import json

    return tuple(f"{key}={json.dumps(value)}" for key, value in options.items() if value is not None)
