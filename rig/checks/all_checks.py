"""All checks of a rig -> what was measured, and sentences about faults."""

import trimesh
from msgspec import Struct

from rig.assembly import Body
from rig.checks import fits, light_path, overhangs, surfaces
from rig.checks.fits import Gap
from rig.checks.overhangs import Overhang
from rig.layout import Layout

__all__ = ["Checked", "check"]


class Checked(Struct, frozen=True):
    """What was measured of a rig."""

    gaps: list[Gap]
    thinnest_mm: dict[str, float]
    overhangs: dict[str, list[Overhang]]
    faults: list[str]


def check(layout: Layout, bodies: list[Body], meshes: dict[str, trimesh.Trimesh]) -> Checked:
    """Check everything.

    Args:
        layout: The layout.
        bodies: All bodies.
        meshes: Their meshes by name, in the eye frame.
    """
    printed = {body.kind: (meshes[body.name], body.print) for body in bodies if body.print}
    faults = []
    for name, (mesh, _) in printed.items():
        faults += surfaces.watertight_faults(name, mesh)
    if faults:  # distances and rays need closed surfaces
        return Checked([], {}, {}, faults)
    gaps = fits.gaps_of(bodies, meshes, layout.is_board)
    faults += fits.faults_of(gaps)
    hanging = {}
    for name, (mesh, print_) in printed.items():
        hanging[name] = overhangs.overhangs_of(mesh, print_)
        faults += surfaces.bed_faults(name, mesh, print_) + surfaces.wall_faults(name, mesh, print_)
        faults += overhangs.faults_of(name, hanging[name], print_)
    in_rig = {body.name: meshes[body.name] for body in bodies if body.group == "rig"}
    faults += light_path.faults_of(layout, in_rig) + light_path.instrument_faults(layout, in_rig)
    return Checked(
        gaps=gaps,
        thinnest_mm={name: surfaces.thinnest_mm(mesh) for name, (mesh, _) in printed.items()},
        overhangs=hanging,
        faults=faults,
    )
