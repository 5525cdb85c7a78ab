"""Commands that prepare a run: register, check, procedure."""

import sys
from typing import TYPE_CHECKING, Any, Literal

import click

from haptigraph.commands.help import TaskGroup, examples
from haptigraph.commands.options import profile_option, set_option, voxel_option
from haptigraph.commands.terminal import progress_bar
from haptigraph.errors import BadInput, unknown_name

if TYPE_CHECKING:
    from haptigraph.haptics.profiles.profile import DeviceProfile
    from haptigraph.inference.procedure import Procedure
    from haptigraph.messages import Capabilities
    from haptigraph.stages import PerceiverClass

TURNS = ("source.rotate_deg", "source.mirror")

__all__ = ["check", "procedure", "procedure_list", "procedure_new", "register"]


@click.command(
    epilog=examples(
        "haptigraph register clip.mp4 -o eye.toml --target 602,641",
        "haptigraph register photo.png -o eye.toml --trocar right --target-mm 1.5 --diameter-mm 23.5",
        "haptigraph register clip.mp4 -o eye.toml --lens lens.toml --set source.rotate_deg=180",
        "haptigraph register --rig rig/d405.toml clip.mp4 -o eye.toml",
        "haptigraph register --volumes scans/needle -o needle.npz --voxel-mm 0.0058,0.079,0.051",
    )
)
@click.argument("source", required=False)
@click.option(
    "-o",
    "--output",
    metavar="FILE",
    required=True,
    help="Registration to write (TOML), or instrument (.npz).",
)
@click.option("--volumes", metavar="FOLDER", help="Learn an instrument from OCT volumes instead.")
@voxel_option
@click.option("--target", metavar="X,Y", help="Target in pixels of the stored image.")
@click.option("--target-mm", type=float, help="Or in mm along the retina from its lowest point; assumed: 0.")
@click.option("--trocar", metavar="left|right|X,Y", help="Trocar in use, if motion does not show it.")
@click.option(
    "--mirrored/--not-mirrored", default=None, help="Whether a mirror flips the images; assumed: it does."
)
@click.option("--diameter-mm", type=float, help="Inner diameter of the globe; assumed: 24.")
@click.option(
    "--rig", metavar="RIG.TOML", help="Design of the set-up: where to search, scale, mirror, target."
)
@click.option("--lens", metavar="FILE", help="Lens of the camera, from `haptigraph calibrate camera`.")
@click.option(
    "--picture", metavar="FILE", help="PNG to draw; default: the name in -o, with .png. Never SOURCE itself."
)
@click.option("--images", default=40, show_default=True, help="Number of images of SOURCE to use.")
@click.option("--force", is_flag=True, help="Overwrite existing files.")
@set_option
def register(
    source: str | None,
    output: str,
    volumes: str | None,
    voxel_mm: tuple[float, float, float] | None,
    rig: str | None,
    picture: str | None,
    force: bool,
    settings: tuple[str, ...],
    **overrides: Any,
) -> None:
    """Find eye, retina and trocars in SOURCE automatically, and write the registration.

    SOURCE is an image, or what `run` takes except a camera; best a clip in which the needle enters and turns.
    The eye must be upright, trocars on top: else --set source.rotate_deg=90, 180 or 270, clockwise.
    For B-scans (oct:PATH) the command checks scale and crop instead, which you set with
    --set source.axial_mm_per_px=..., source.lateral_mm_per_px=... and source.crop_px=[LEFT,TOP,WIDTH,HEIGHT].
    With --rig the design of a printed set-up says where to search and states scale, mirror and target; the
    report says how far the registration is from the design, and warns beyond 3 standard deviations.
    With --volumes it learns the model of an instrument that is alone in its volumes, without labels.
    """
    from haptigraph.analysis.registering.oct import is_bscan_source, register_scans
    from haptigraph.analysis.registering.overrides import Overrides
    from haptigraph.analysis.registering.registering import register_source
    from haptigraph.config import load_config

    if volumes is not None:
        _check_volume_options(source, rig, picture, settings, overrides)
        _learn_instrument(volumes, output, voxel_mm, force=force)
        return
    if source is None or voxel_mm is not None:
        problem = "register takes either SOURCE or --volumes FOLDER"
        raise BadInput(problem if source is None else "--voxel-mm goes with --volumes FOLDER")
    if is_bscan_source(source):
        if rig is not None:
            raise BadInput("--rig is for an eye before a camera; B-scans have no rig")
        if overrides["lens"] is not None:
            raise BadInput("--lens is for cameras; B-scans have no lens distortion to correct")
        with progress_bar() as progress:
            report = register_scans(
                source,
                output,
                settings,
                picture,
                force=force,
                max_images=overrides["images"],
                progress=progress,
            )
        click.echo(report)
        return
    turn = load_config(None, settings).source.turn
    if any(not setting.startswith(TURNS) for setting in settings):
        problem = f"--set is for B-scans (oct:PATH); for {source} only {' and '.join(TURNS)} are valid"
        raise BadInput(problem)
    given = Overrides(**overrides, turn=turn)
    with progress_bar() as progress:
        report = register_source(source, output, given, picture, rig=rig, force=force, progress=progress)
    click.echo(report)


def _check_volume_options(
    source: str | None,
    rig: str | None,
    picture: str | None,
    settings: tuple[str, ...],
    overrides: dict[str, Any],
) -> None:
    """Refuse options that have no meaning for volumes."""
    of_images = [value for name, value in overrides.items() if name != "images"]
    if any(value is not None for value in (source, rig, picture, *settings, *of_images)):
        raise BadInput("--volumes goes with -o, --voxel-mm and --force only")


def _learn_instrument(
    folder: str, output: str, voxel_mm: tuple[float, float, float] | None, *, force: bool
) -> None:
    from haptigraph.analysis.registering.instrument import register_instrument
    from haptigraph.perception.instrument.model import VOXEL_MM

    with progress_bar() as progress:
        report = register_instrument(folder, output, voxel_mm or VOXEL_MM, force=force, progress=progress)
    click.echo(report)


@click.command(
    epilog=examples(
        "haptigraph check",
        "haptigraph check my.toml --picture violations.svg",
        "haptigraph check my.toml --perceiver forceps --device gamepad",
        "haptigraph check --profile pad.toml",
    )
)
@click.argument("procedure", default="subretinal_injection")
@click.option(
    "--prover",
    type=click.Choice(["auto", "exhaustive", "z3"]),
    default="auto",
    help="Enumerate every graph, or use z3; auto: whichever fits.",
)
@click.option("--picture", metavar="FILE", help="Draw the graphs that violate a claim: PNG, SVG or PDF.")
@click.option("--perceiver", default="auto", help="What will report the entities; auto: as in a run.")
@click.option(
    "--device", metavar="DEVICE", help="Prove as well that this device can play every pattern; see `devices`."
)
@profile_option
def check(
    procedure: str,
    prover: Literal["auto", "exhaustive", "z3"],
    picture: str | None,
    perceiver: str,
    device: str | None,
    profile: str | None,
) -> None:
    """Explain PROCEDURE in tables, and prove its claims over every possible graph.

    Among them: every pattern is felt, an alarm is the strongest and unlike all else, and what follows a
    measure grows towards danger. What no claim covers is listed at the end. With --profile: every pattern is
    as strong as meant on the device, above its threshold, and distinct.

    Exit code 1 if a claim is violated; the smallest graph that violates it is shown.
    """
    from rich.console import Console
    from rich.text import Text

    from haptigraph.analysis.plots.explanation import explain
    from haptigraph.analysis.plots.proof_text import claims_table, proof_summary
    from haptigraph.assemble import load_procedure
    from haptigraph.proof.prove import prove

    if picture:
        from haptigraph.analysis.plots.proof_figure import proof_figure
    loaded = load_procedure(procedure)
    measured, capable = _device_of(device, profile)
    proof = prove(loaded, prover, capable, _perceiving(loaded, perceiver), measured)
    if picture:
        proof_figure(loaded, proof, picture)
    # No markup: square brackets belong to the user's text. No line breaks where no terminal needs them.
    console = Console(markup=False, emoji=False, width=None if sys.stdout.isatty() else 10_000)
    console.print(Text.assemble((loaded.title, "bold"), f"  {loaded.source}\nsha256 {loaded.sha256}"))
    for table in (*explain(loaded), claims_table(proof)):
        console.print(table)
    console.print(proof_summary(proof), highlight=False)
    if not proof.holds:
        sys.exit(1)


def _perceiving(procedure: "Procedure", perceiver: str) -> "tuple[str, PerceiverClass]":
    """Return the name and the class of the perceiver that a run would use."""
    from haptigraph.assemble import perceiver_class, perceiver_name
    from haptigraph.config import Config

    name = perceiver_name(Config().with_perceiver(perceiver), procedure)
    return name, perceiver_class(name)


def _device_of(
    device: str | None, file: str | None
) -> "tuple[DeviceProfile | None, tuple[str, Capabilities] | None]":
    """Return a device's profile, its name and its capabilities, without opening it; None: not given.

    A profile names its device, so that --device may be left out.
    """
    from haptigraph.haptics.profiles.profile import check_device, load_profile
    from haptigraph.run_device import device_class

    profile = load_profile(file) if file else None
    if profile is not None:
        device = device or profile.device.uri
        check_device(profile, device, file or "")
    if device is None:
        return None, None
    kind = device.partition(":")[0]
    return profile, (kind, device_class(kind).capabilities)


@click.group(
    cls=TaskGroup,
    tasks={"Commands": ("list", "new")},
    epilog=examples("haptigraph procedure list", "haptigraph procedure new --from NAME -o my.toml"),
)
def procedure() -> None:
    """List the shipped procedures, or copy one to edit.

    A procedure is a TOML file with rules and haptic patterns. The documentation's page Procedures explains
    each key.
    """


@procedure.command("list", epilog=examples("haptigraph procedure list"))
def procedure_list() -> None:
    """List the procedures that ship with haptigraph."""
    from haptigraph.assemble import load_procedure, procedure_names

    names = procedure_names()
    width = max(map(len, names))
    for name in names:
        loaded = load_procedure(name)
        click.echo(f"{name:{width}}  {loaded.title}, {len(loaded.states)} states")
    click.echo("\nCopy one to edit: haptigraph procedure new --from NAME -o my.toml")


@procedure.command(
    "new",
    epilog=examples(
        "haptigraph procedure new --from subretinal_injection -o my.toml",
        "haptigraph procedure new --from run.mcap -o recorded.toml",
        "haptigraph check my.toml",
        "haptigraph live --procedure my.toml",
    ),
)
@click.option(
    "--from",
    "name",
    metavar="NAME|RECORDING",
    required=True,
    help="Shipped procedure, or the one of a recording.",
)
@click.option("-o", "--output", metavar="FILE", required=True, help="TOML file to write.")
@click.option("--force", is_flag=True, help="Overwrite an existing file.")
def procedure_new(name: str, output: str, force: bool) -> None:
    """Copy a shipped procedure, or the one of a recording, to a file of your own, to edit it."""
    from pathlib import Path

    text, path = _procedure_text(name), Path(output)
    if path.suffix != ".toml":
        raise BadInput("the name of a procedure's file ends in .toml", path)
    if not path.parent.is_dir():
        raise BadInput("its folder does not exist; create it first", path)
    try:
        with path.open("wb" if force else "xb") as file:
            file.write(text)
    except FileExistsError:
        raise BadInput("exists already; --force overwrites it", path) from None
    click.echo(f"{path} was written; edit it, then prove it and run it:")
    click.echo(f"  haptigraph check {path}\n  haptigraph live --procedure {path}")


def _procedure_text(name: str) -> bytes:
    """Return the TOML text of a shipped procedure, or of that in a recording."""
    from importlib import resources

    from haptigraph.assemble import procedure_names
    from haptigraph.recording.reader import RunReader

    if name.endswith(".mcap"):
        return RunReader(name).info.procedure.encode()
    if name not in procedure_names():
        raise BadInput(unknown_name("procedure", name, procedure_names()))
    return resources.files("haptigraph.procedures").joinpath(f"{name}.toml").read_bytes()
