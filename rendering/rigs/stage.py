"""Set up a rig in Blender from the meshes of its CAD, and take its picture.

Blender's world frame is the eye frame [mm]. The camera looks into the mirror; nothing is unfolded, so
that the picture tests the geometry of `haptigraph.rig.view`.
"""

import math
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

from haptigraph.rig.description import Rig
from haptigraph.rig.view import Build, View
from rendering.materials import Material, mottled, plain
from rendering.stage import add, silence

__all__ = ["RigStage"]

EYE = "eye", "retina", "target"
COLORS = {"eye": (0.8, 0.8, 0.78), "retina": (0.75, 0.3, 0.12), "target": (0.03, 0.03, 0.05)}
PRINTED_COLOR = (0.12, 0.12, 0.13)
LEDS, LED_MM, LED_W = 8, 5.0, 2500.0
AMBIENT = 0.25
SAMPLES = 8
FRAMED = 1.6  # half the rendered square, relative to the globe's radius
FILTER_PX = 1.5
MM_PER_UNIT = 1000.0  # Blender takes the unit of length for a metre where it computes the aperture


class RigStage:
    """One rig as built; only one can exist at a time.

    Args:
        rig: The design.
        meshes: Folder with an STL of each body as designed, eye frame; what is named camera is left out.
        build: How the rig differs from the design, n = 1; without errors of ports, target and cut face.
    """

    def __init__(self, rig: Rig, meshes: Path, build: Build) -> None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._rig, self._view = rig, View(rig, build)
        for file in sorted(meshes.glob("*.stl")):
            if not file.stem.startswith("camera"):
                self._add_body(file, build)
        self._add_leds()
        self._add_camera()
        _set_up_cycles(rig)
        self._frame_eye()

    def render(self, file: Path) -> None:
        """Take the picture, as a PNG that appears when it is complete; far from the eye it is black."""
        part = file.with_name("part.png")
        bpy.context.scene.render.filepath = str(part)
        with silence():
            bpy.ops.render.render(write_still=True)
        part.replace(file)

    def _add_body(self, file: Path, build: Build) -> None:
        name = file.stem
        with silence():
            bpy.ops.wm.stl_import(filepath=str(file))
        body = bpy.context.object
        body.data.materials.append(_material(name))
        if name in EYE:
            scale = 1 + float(build.radius_mm[0]) / (self._rig.eye.diameter_mm / 2)
            body.matrix_world = Matrix.Translation(Vector(build.eye_mm[0])) @ Matrix.Scale(scale, 4)
        elif name == "mirror":
            pivot = Vector((0, 0, self._rig.mirrors[0].from_section_mm))
            turn = np.radians(build.mirror_deg[0])
            angle = float(np.linalg.norm(turn))
            rotation = Matrix.Rotation(angle, 4, Vector(turn)) if angle else Matrix.Identity(4)
            moved = Matrix.Translation(pivot + Vector(build.mirror_mm[0]))
            body.matrix_world = moved @ rotation @ Matrix.Translation(-pivot)

    def _frame_eye(self) -> None:
        """Render only the eye and what is around it."""
        camera, settings = self._rig.camera, bpy.context.scene.render
        (x, y), depth_mm = self._view.to_px(np.zeros((1, 3)))[0, 0], float(self._view.center_depth_mm[0])
        half_px = FRAMED * self._rig.eye.diameter_mm / 2 * float(self._view.focal_px[0]) / depth_mm
        settings.use_border = True
        settings.border_min_x, settings.border_max_x = (
            min(max(side / camera.width_px, 0.0), 1.0) for side in (x - half_px, x + half_px)
        )
        settings.border_min_y, settings.border_max_y = (
            min(max(1 - side / camera.height_px, 0.0), 1.0) for side in (y + half_px, y - half_px)
        )

    def _add_leds(self) -> None:
        light = self._rig.light
        for number in range(LEDS):
            angle = 2 * math.pi * (number + 0.5) / LEDS
            place = Vector((math.cos(angle), math.sin(angle), 0)) * light.diameter_mm / 2
            place.z = light.from_section_mm + LED_MM
            area = bpy.data.lights.new("led", "AREA")
            area.shape, area.size, area.energy = "DISK", LED_MM, LED_W
            lamp = add("led", area)
            lamp.location = place
            lamp.rotation_euler = place.to_track_quat("Z", "Y").to_euler()
        world = bpy.data.worlds.new("world")
        world.use_nodes = True
        world.node_tree.nodes["Background"].inputs["Strength"].default_value = AMBIENT
        bpy.context.scene.world = world

    def _add_camera(self) -> None:
        of, data = self._rig.camera, bpy.data.cameras.new("camera")
        principal_px = self._view.principal_px[0] - (np.array([of.width_px, of.height_px]) - 1) / 2
        data.sensor_fit, data.sensor_width = "HORIZONTAL", of.width_px * of.pixel_um / 1000
        data.lens = data.sensor_width * float(self._view.focal_px[0]) / of.width_px
        data.shift_x, data.shift_y = -principal_px[0] / of.width_px, principal_px[1] / of.width_px
        data.clip_start, data.clip_end = 0.1, 2000
        data.dof.use_dof, data.dof.focus_distance = True, of.focus_mm
        data.dof.aperture_fstop = of.f_number / MM_PER_UNIT
        camera = add("camera", data)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self._view.camera_axes[0], self._view.camera_mm[0]
        camera.matrix_world = Matrix(pose.tolist())
        bpy.context.scene.camera = camera


def _material(name: str) -> Material:
    if name == "mirror":
        return plain(name, (0.95, 0.95, 0.95), 0.0, is_metal=True)
    if name in COLORS:
        return mottled(name, COLORS[name], 0.7, share=0.02, per_mm=1.2)
    return plain(name, PRINTED_COLOR, 0.7)


def _set_up_cycles(rig: Rig) -> None:
    scene = bpy.context.scene
    scene.view_settings.view_transform = "Standard"
    settings, cycles = scene.render, scene.cycles
    settings.engine = "CYCLES"
    settings.resolution_x, settings.resolution_y = rig.camera.width_px, rig.camera.height_px
    settings.image_settings.file_format, settings.image_settings.color_mode = "PNG", "RGB"
    cycles.device, cycles.samples, cycles.seed = "CPU", SAMPLES, 1
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 5, 2, 3
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", FILTER_PX
