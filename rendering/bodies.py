"""Bodies in Blender: the opened eye, instruments, beads and surroundings.

Blender's world frame: x right, y away from the camera, z up [mm]; origin at the image centre in the plane of
the section (y = 0).
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from random import Random

import bmesh
import bpy
import numpy as np
from mathutils import Matrix, Vector

from haptigraph.geometry import Vec
from rendering.layout import CUT_MM, WALL_MM, Layout
from rendering.materials import Material, bowl_material, mottled, needle_material, plain, wooden
from rendering.scene import Instrument, Needle

__all__ = ["add_beads", "add_bowl", "add_needle", "add_second_instrument", "add_surroundings", "place"]

HOLE_RADIUS_MM = 0.5
SHAFT_MM = 60.0
BEVEL_DEG = 22.0
NEEDLE_SEGMENTS, BOWL_SEGMENTS = 48, 256
BEAD_COLOR, SCREW_COLOR = (0.9, 0.9, 0.9), (0.7, 0.7, 0.7)
WOOD_COLOR, DARK_COLOR = (0.42, 0.29, 0.2), (0.12, 0.09, 0.07)

Object = bpy.types.Object
Profile = Sequence[tuple[float, float]]


def add_bowl(layout: Layout) -> Object:
    """Add the eye: a hemisphere with a wall and a port for each trocar."""
    bowl = _spun("bowl", _bowl_profile(layout.eye.radius_mm), "Y", BOWL_SEGMENTS)
    bowl.location = _center(layout)
    look = layout.scene.bowl
    bowl.data.materials.append(bowl_material(look))
    bowl.data.materials.append(mottled("rim", look.rim_color, 0.6, share=0.04, per_mm=1.5))
    for face in bowl.data.polygons:
        is_cut = abs(face.center.y + CUT_MM) < 1e-3
        is_outside = face.center.length > layout.eye.radius_mm + 0.5
        face.material_index = int(is_cut or is_outside)
        face.use_smooth = not is_cut
    for eye in layout.eyes.values():
        trocar = _in_world(eye.trocar_mm)
        bpy.ops.mesh.primitive_cylinder_add(
            radius=HOLE_RADIUS_MM, depth=6, vertices=48, location=bowl.location + trocar
        )
        drill = bpy.context.object
        drill.rotation_euler = trocar.to_track_quat("Z", "Y").to_euler()
        _cut_out(bowl, drill)
    return bowl


def _bowl_profile(radius_mm: float) -> Profile:
    """Return the closed outline of the wall as (distance from the axis, depth), inner surface first."""
    outer_mm = radius_mm + WALL_MM
    inner_cut, outer_cut = math.asin(CUT_MM / radius_mm), math.asin(CUT_MM / outer_mm)
    inner = [
        (radius_mm * math.cos(angle), radius_mm * math.sin(angle))
        for angle in np.linspace(-inner_cut, math.pi / 2, 90)
    ]
    outer = [
        (outer_mm * math.cos(angle), outer_mm * math.sin(angle))
        for angle in np.linspace(math.pi / 2, -outer_cut, 90)
    ]
    return [*inner, *outer, inner[0]]


def add_needle(needle: Needle) -> Object:
    """Add the needle; `place` positions it."""
    profile = _needle_profile(needle.point, needle.width_mm / 2, needle.taper_mm)
    added = _spun("needle", profile, "Z", NEEDLE_SEGMENTS)
    added.data.materials.append(needle_material(needle))
    if needle.point == "bevel":
        _cut_bevel(added, needle.width_mm / 2)
    return added


def add_second_instrument(instrument: Instrument, end_mm: Vec, direction: Vec, layout: Layout) -> None:
    """Add a stationary instrument."""
    profile = _needle_profile("round", instrument.width_mm / 2)
    added = _spun("second", profile, "Z", NEEDLE_SEGMENTS)
    added.data.materials.append(
        plain("second", instrument.color, instrument.roughness, is_metal=instrument.is_metal)
    )
    place(added, layout, end_mm, direction)


def _needle_profile(point: str, radius_mm: float, taper_mm: float | None = None) -> Profile:
    """Return the outline of a needle as (distance from the axis, distance from its end)."""
    shaft = (radius_mm, SHAFT_MM)
    if point == "cone" and taper_mm is not None:
        tip_radius_mm, cap_mm = 0.02, 0.03
        shares = np.linspace(tip_radius_mm, 1, 30)
        cone = [
            (tip_radius_mm + (radius_mm - tip_radius_mm) * share, cap_mm + (taper_mm - cap_mm) * share)
            for share in shares
        ]
        return [(0, 0), (tip_radius_mm, cap_mm), *cone, shaft]
    if point == "blunt":
        return [(0, 0), (radius_mm * 0.7, 0), (radius_mm * 0.95, 0.05), (radius_mm, 0.12), shaft]
    if point == "round":
        quarter = np.linspace(0, math.pi / 2, 16)
        return [(radius_mm * math.sin(a), radius_mm - radius_mm * math.cos(a)) for a in quarter] + [shaft]
    return [(0, 0), (radius_mm, 0), shaft]


def _cut_bevel(needle: Object, radius_mm: float) -> None:
    """Cut a bevel, so that the point of the needle is at its local +x side."""
    bevel = math.radians(BEVEL_DEG)
    mesh = bmesh.new()
    mesh.from_mesh(needle.data)
    cut = bmesh.ops.bisect_plane(
        mesh,
        geom=[*mesh.verts, *mesh.edges, *mesh.faces],
        plane_co=(radius_mm, 0, 0),
        plane_no=(-math.cos(bevel), 0, -math.sin(bevel)),
        clear_outer=True,
    )
    edges = [edge for edge in cut["geom_cut"] if isinstance(edge, bmesh.types.BMEdge)]
    bmesh.ops.edgeloop_fill(mesh, edges=edges)
    mesh.to_mesh(needle.data)
    mesh.free()
    for face in needle.data.polygons:
        face.use_smooth = False


def place(instrument: Object, layout: Layout, end_mm: Vec, direction: Vec, roll_deg: float = 0.0) -> None:
    """Position an instrument by its end and its shaft's direction (towards the end), eye frame."""
    along = -_in_world(direction)
    away = Vector((0, 1, 0))
    rotation = Matrix((away.cross(along), away, along)).transposed().to_4x4()
    pose = rotation @ Matrix.Rotation(math.radians(roll_deg), 4, "Z")
    pose.translation = _center(layout) + _in_world(end_mm)
    instrument.matrix_world = pose


def add_surroundings(layout: Layout, random: Random) -> None:
    """Add a wooden holder in front of a dark background, with a bar, a rod and two screws."""
    up_mm = layout.scene.camera.globe_mm[1]
    wood = wooden("wood", WOOD_COLOR)
    _add_box((-60, 60), (14.5, 16), (-60, 60), mottled("dark", DARK_COLOR, 0.8, share=0.1, per_mm=0.3))
    holder = _add_box((-30, 30), (3, 14), (-60, up_mm + 2.5 + random.uniform(-1, 1)), wood)
    for sides_mm in ((-60, -29), (29, 60)):
        _add_box(sides_mm, (-2, 14), (-60, 60), wood)
    bpy.ops.mesh.primitive_uv_sphere_add(
        radius=layout.eye.radius_mm + WALL_MM + 0.1, segments=96, ring_count=48, location=_center(layout)
    )
    _cut_out(holder, bpy.context.object)
    _add_bar(5.0, 56, 64, (0, 8, up_mm + 17.5), 0.0, wood)
    rod = plain("rod", layout.scene.rod_color, 0.5)
    _add_bar(0.8, 58, 48, (0, 9, up_mm + 10), random.uniform(-0.1, 0.1), rod)
    for right_mm in (-20, 20):
        bpy.ops.mesh.primitive_uv_sphere_add(radius=1.2, location=(right_mm, 2.6, up_mm - 6))
        _finish(plain("screw", SCREW_COLOR, 0.25, is_metal=True))


def add_beads(layout: Layout, random: Random) -> None:
    """Add beads in the bowl or floating above it."""
    right_mm, up_mm = layout.scene.camera.globe_mm
    for _ in range(layout.scene.beads):
        x, z = random.uniform(-8, 8), random.uniform(-9, 6)
        radius_mm = random.uniform(0.3, 0.9)
        floor_mm = math.sqrt(max(layout.eye.radius_mm**2 - x * x - z * z, 1))
        location = (right_mm + x, floor_mm - random.uniform(0.5, 2), up_mm + z)
        bpy.ops.mesh.primitive_uv_sphere_add(radius=radius_mm, location=location)
        _finish(plain("bead", BEAD_COLOR, 0.05))


def _add_box(x_mm: Vec, y_mm: Vec, z_mm: Vec, material: Material) -> Object:
    sides_mm = (x_mm, y_mm, z_mm)
    bpy.ops.mesh.primitive_cube_add(size=1, location=[(low + high) / 2 for low, high in sides_mm])
    box = bpy.context.object
    box.scale = [high - low for low, high in sides_mm]
    box.data.materials.append(material)
    return box


def _add_bar(
    radius_mm: float,
    length_mm: float,
    segments: int,
    center_mm: tuple[float, float, float],
    slope_rad: float,
    material: Material,
) -> None:
    """Add a cylinder across the image."""
    bpy.ops.mesh.primitive_cylinder_add(
        radius=radius_mm,
        depth=length_mm,
        vertices=segments,
        location=center_mm,
        rotation=(0, math.pi / 2 + slope_rad, 0),
    )
    _finish(material)


def _finish(material: Material) -> None:
    """Assign a material to the active object, and shade it smooth."""
    bpy.context.object.data.materials.append(material)
    bpy.ops.object.shade_smooth()


def _cut_out(body: Object, tool: Object) -> None:
    """Subtract an invisible tool from a body."""
    modifier = body.modifiers.new("cut", "BOOLEAN")
    modifier.operation, modifier.solver, modifier.object = "DIFFERENCE", "EXACT", tool
    tool.hide_render = tool.hide_viewport = True


def _spun(name: str, profile: Profile, axis: str, segments: int) -> Object:
    """Return the solid of revolution of a profile about an axis."""
    is_upright = axis == "Z"
    outline = [(across, 0, along) if is_upright else (across, along, 0) for across, along in profile]
    mesh = bmesh.new()
    vertices = [mesh.verts.new(point_mm) for point_mm in outline]
    edges = [mesh.edges.new(pair) for pair in pairwise(vertices)]
    bmesh.ops.spin(
        mesh,
        geom=vertices + edges,
        axis=(0, 0, 1) if is_upright else (0, 1, 0),
        angle=2 * math.pi,
        steps=segments,
        use_merge=True,
    )
    bmesh.ops.remove_doubles(mesh, verts=mesh.verts, dist=1e-5)
    bmesh.ops.recalc_face_normals(mesh, faces=mesh.faces)
    data = bpy.data.meshes.new(name)
    mesh.to_mesh(data)
    mesh.free()
    for face in data.polygons:
        face.use_smooth = True
    body = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(body)
    return body


def _center(layout: Layout) -> Vector:
    return _in_world(layout.scene.camera.globe_mm)


def _in_world(point_mm: Vec) -> Vector:
    return Vector((point_mm[0], 0, point_mm[1]))
