"""The command that draws a recorded trial as a video: study video."""

from pathlib import Path

import click

from haptigraph.commands.help import examples
from haptigraph.commands.terminal import progress_bar
from haptigraph.errors import BadInput

__all__ = ["video"]

MAX_NAMES = 10


@click.command(
    epilog=examples("haptigraph study video my-study/recordings/P01/trial-1-1-1-attempt1.mcap -o trial.mp4")
)
@click.argument("trial")
@click.option("-o", "--output", metavar="FILE", required=True, help="The MP4 to write.")
def video(trial: str, output: str) -> None:
    """Draw TRIAL, a recording, as a video: state, needle, target, retina, and the haptic output below.

    It runs in real time and plays in browsers. It contains no pseudonym; show it only with the participant's
    consent. Needs haptigraph[video].
    """
    from haptigraph.analysis.plots.run_video import run_video

    _check_recording(Path(trial))
    with progress_bar() as progress:
        codec = run_video(trial, output, progress)
    also = "" if codec == "H.264" else ": this PyAV has no encoder for H.264, and not every browser plays it"
    click.echo(f"{output}  {codec}{also}")


def _check_recording(path: Path) -> None:
    """Refuse what is no recording, with those that are there."""
    if path.is_file():
        return
    folder = path if path.is_dir() else path.parent
    found = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*.mcap"))
    more = f" and {len(found) - MAX_NAMES} more" if len(found) > MAX_NAMES else ""
    listed = f"{folder} has {', '.join(found[:MAX_NAMES])}{more}" if found else f"{folder} has no recordings"
    raise BadInput(
        f"{'is a folder' if path.is_dir() else 'does not exist'}; give a recording: {listed}", path
    )
