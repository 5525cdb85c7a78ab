"""The commands. Each parses, assembles and calls; everything heavy is imported when a command needs it."""

import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import haptigraph
from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.terminal import progress as _progress
from haptigraph.terminal import tell as _tell
from haptigraph.terminal import terminable as _terminable

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
            _tell(f"haptigraph: {error}")
            ctx.exit(2)
        except BrokenPipeError:
            raise  # whoever read the output has seen enough; click ends quietly
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            _tell(f"haptigraph: {where}{error.strerror or error}")
            ctx.exit(2)
        except KeyboardInterrupt:
            _tell("haptigraph: stopped")
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

    with _progress() as progress:
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
@click.argument("clip_dir")
@click.option("--perceiver", metavar="NAME", help="Which perceiver to score.")
@procedure_option
@config_option
@set_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def evaluate(
    clip_dir: str,
    perceiver: str | None,
    procedure: str | None,
    config: str | None,
    settings: tuple[str, ...],
    as_json: bool,
) -> None:
    """Score perception and states on a labelled clip.

    CLIP_DIR holds clip.mp4, registration.toml and truth.csv.
    """
    import msgspec

    from haptigraph.analysis.evaluation import evaluate_clip
    from haptigraph.config import load_config

    options = {"perception.perceiver": perceiver, "run.procedure": procedure}
    settled = load_config(config, (*settings, *_settings(options)))
    with _progress() as progress:
        evaluation = evaluate_clip(clip_dir, settled, progress)
    if as_json:
        click.echo(msgspec.json.encode(evaluation.scores).decode())
        return
    for name, value in _flat(evaluation.scores):
        click.echo(f"{name:34}{value}")
    lag = evaluation.lag_images
    told = "-" if lag is None else f"{lag:.2f} images behind the truth (alpha {settled.perception.alpha:g})"
    click.echo(f"{'lag':34}{told}")


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
    with _progress() as progress:
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
    with _progress() as progress:
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
    with _terminable(), _progress() as progress:
        console = ConsoleSink(shows_time=not is_realtime(config))
        with closing(build(config, sinks=[console], progress=progress)) as loop:
            for note in loop.notes:
                _tell(f"{config.haptics.device}: {note}")
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


def _flat(scores: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Turn nested scores into (name, value) lines."""
    for name, value in scores.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", f"{value:.4g}" if isinstance(value, float) else str(value)
