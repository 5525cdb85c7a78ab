"""Build a rig: `python -m rig.build rig/d405.toml` writes build/rig/NAME/. Run by `make rig`.

parts/ has STEP and STL (as it lies on the bed), drawings/ SVG and PDF, meshes/ STL in the eye frame; beside
them are assembly.step, bom.csv, bom.md, print.md and checks.md. If a check fails, nothing is written, and the
exit code is 2.
"""

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

import trimesh
from build123d import Compound, export_step

from haptigraph.errors import BadInput
from haptigraph.rig.description import load_rig
from rig import lists
from rig.assembly import Body, bodies_of
from rig.checks.all_checks import Checked, check
from rig.drawings import write_drawing
from rig.layout import Layout, layout_of
from rig.meshes import mesh_of, on_bed
from rig.pictures import write_pictures

__all__ = ["build", "main"]


def main() -> None:
    """Build the rigs named on the command line."""
    parser = argparse.ArgumentParser(
        prog="rig.build",
        description="Build the CAD of a rig.",
        epilog="example: python -m rig.build rig/d405.toml",
    )
    parser.add_argument("rig", type=Path, nargs="+", help="a rig.toml")
    parser.add_argument("-o", "--output", type=Path, default=Path("build/rig"), help="folder (build/rig)")
    parser.add_argument("--pictures", action="store_true", help="render pictures too; minutes")
    arguments = parser.parse_args()
    try:
        for file in arguments.rig:
            print(f"{file}: wrote {build(file, arguments.output, arguments.pictures)}")
    except BadInput as error:
        print(f"rig: {error}", file=sys.stderr)
        raise SystemExit(2) from None


def build(file: Path, output: Path, pictures: bool = False) -> Path:
    """Build one rig.

    Args:
        file: Its rig.toml.
        output: A folder; the rig gets a folder in it, named like its file.
        pictures: Whether to render pictures too.

    Returns:
        The rig's folder.

    Raises:
        BadInput: If the file is not valid, or a check fails; then nothing is written.
    """
    layout = layout_of(load_rig(file), file)
    bodies = bodies_of(layout)
    meshes = {body.name: mesh_of(body.shape) for body in bodies}
    checked = check(layout, bodies, meshes)
    if checked.faults:
        raise BadInput("; ".join(checked.faults), file)
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=output) as scratch:
        folder = Path(scratch) / file.stem
        _write(layout, bodies, meshes, checked, folder)
        if pictures:
            (folder / "pictures").mkdir()
            write_pictures(layout, bodies, meshes, folder / "pictures")
        target = output / file.stem
        shutil.rmtree(target, ignore_errors=True)
        folder.rename(target)
    return target


def _write(
    layout: Layout, bodies: list[Body], meshes: dict[str, trimesh.Trimesh], checked: Checked, folder: Path
) -> None:
    name = layout.rig.name
    for part in ("parts", "drawings", "meshes"):
        (folder / part).mkdir(parents=True)
    done = set()
    for body in bodies:
        if body.group == "rig":
            meshes[body.name].export(folder / "meshes" / f"{body.name}.stl")
        if not body.print or body.kind in done:
            continue
        done.add(body.kind)
        export_step(body.shape, folder / "parts" / f"{body.kind}.step")
        on_bed(meshes[body.name], body.print).export(folder / "parts" / f"{body.kind}.stl")
        write_drawing(body.kind, name, body.shape, body.print, folder / "drawings")
    for body in bodies:
        body.shape.label = body.name
    assembly = Compound(label=name, children=[body.shape for body in bodies if body.group == "rig"])
    export_step(assembly, folder / "assembly.step")
    items = lists.bill_of(layout, bodies)
    texts = {
        "bom.csv": lists.bill_csv(items),
        "bom.md": lists.bill_md(name, items),
        "print.md": lists.settings_md(name, bodies, meshes),
        "checks.md": lists.checks_md(name, checked),
    }
    for file, text in texts.items():
        (folder / file).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
