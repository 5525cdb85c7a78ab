"""The commands `calibrate sheet` and `calibrate camera`: a ChArUco sheet, and a lens."""

from pathlib import Path

import click

from haptigraph.commands.help import TaskGroup, examples
from haptigraph.commands.options import set_option
from haptigraph.commands.terminal import progress_bar

__all__ = ["calibrate_lens", "camera", "sheet"]

squares_option = click.option(
    "--squares",
    metavar="COLUMNSxROWS",
    default="24x17",
    show_default=True,
    help="Squares of the sheet.",
)
force_option = click.option("--force", is_flag=True, help="Overwrite an existing file.")


@click.group(
    "calibrate",
    cls=TaskGroup,
    tasks={"Commands": ("sheet", "camera")},
    epilog=examples(
        "haptigraph calibrate sheet -o sheet.pdf",
        "haptigraph calibrate camera camera:0 -o lens.toml",
        "haptigraph register clip.mp4 --lens lens.toml -o eye.toml",
    ),
)
def calibrate_lens() -> None:
    """Calibrate a camera's lens, so that its distortion is corrected.

    A robot is calibrated with `haptigraph robot calibrate`, a device with `haptigraph devices calibrate`.
    """


@calibrate_lens.command(
    "sheet",
    epilog=examples(
        "haptigraph calibrate sheet -o sheet.pdf",
        "haptigraph calibrate sheet -o sheet.svg --squares 20x14 --square-mm 6 --paper letter",
    ),
)
@click.option("-o", "--output", metavar="FILE", required=True, help="Sheet to write: .pdf, .svg or .png.")
@squares_option
@click.option(
    "--square-mm",
    type=click.FloatRange(1, 100),
    default=10.0,
    show_default=True,
    metavar="MM",
    help="Side of a square: about a tenth to a twentieth of the width that the camera sees.",
)
@click.option(
    "--paper", type=click.Choice(["a4", "a3", "letter"]), default="a4", show_default=True, help="Landscape."
)
@force_option
def sheet(output: str, squares: str, square_mm: float, paper: str, *, force: bool) -> None:
    """Write a ChArUco sheet to print at true size.

    Two rulers show whether the printer scaled it. A lens does not depend on the scale, but on both directions
    being scaled alike.
    """
    from haptigraph.analysis.calibrating.board import parse_board
    from haptigraph.analysis.calibrating.sheet import sheet_bytes
    from haptigraph.analysis.registering.registering import check_files
    from haptigraph.files import write_files

    file = Path(output)
    check_files((file,), "", force=force)
    write_files((file,), (sheet_bytes(parse_board(squares), square_mm, paper, file),))
    click.echo(f"{file} was written; print it at 100 % and measure both rulers, then show it to the camera:")
    click.echo(f"  haptigraph calibrate camera camera:0 -o lens.toml --squares {squares}")


@calibrate_lens.command(
    "camera",
    epilog=examples(
        "haptigraph calibrate camera camera:0 -o lens.toml",
        "haptigraph calibrate camera sheet.mp4 -o lens.toml --squares 20x14",
        "haptigraph calibrate camera pictures/ -o lens.toml",
        "haptigraph calibrate camera realsense: -o lens.toml --factory",
    ),
)
@click.argument("source")
@click.option("-o", "--output", metavar="FILE", required=True, help="Lens to write (TOML).")
@squares_option
@click.option(
    "--seconds",
    "duration_s",
    type=click.FloatRange(1, 3600),
    default=120.0,
    show_default=True,
    metavar="S",
    help="How long to read a camera at most.",
)
@click.option("--factory", is_flag=True, help="Read the manufacturer's calibration from a RealSense camera.")
@force_option
@set_option
def camera(
    source: str,
    output: str,
    squares: str,
    duration_s: float,
    settings: tuple[str, ...],
    *,
    factory: bool,
    force: bool,
) -> None:
    """Find the printed sheet in images of SOURCE, and write the camera's lens.

    SOURCE is a camera, a video, or a folder of pictures, at the size and focus of later runs. Show the sheet
    flat, near and far, tilted up to 45 degrees each way, and in every part of the image, also through the
    mirror. What does not determine the lens is refused, with what is missing.
    """
    from haptigraph.analysis.calibrating.board import parse_board
    from haptigraph.analysis.calibrating.calibrating import calibrate_camera, read_factory_lens

    board, file = parse_board(squares), Path(output)
    if factory:
        click.echo(read_factory_lens(source, file, settings, force=force))
        return
    with progress_bar() as progress:
        report = calibrate_camera(
            source, file, board, settings, duration_s=duration_s, force=force, progress=progress
        )
    click.echo(report)
