"""Set up a scene in Blender (bodies, lights, camera, Cycles), and render it with or without the needle."""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import bpy
from mathutils import Vector

from rendering.bodies import add_beads, add_bowl, add_needle, add_second_instrument, add_surroundings, place
from rendering.layout import DISTANCE_MM, HEIGHT_PX, WIDTH_PX, Box, Layout
from rendering.path import Pose
from rendering.scene import Light

__all__ = ["Stage", "add", "silence"]

SAMPLES = 8
LIGHT_MM, LIGHT_W = 150.0, 60_000.0
SENSOR_MM = 36.0


class Stage:
    """A scene in Blender; only one can exist at a time.

    Args:
        layout: Its geometry.
    """

    def __init__(self, layout: Layout) -> None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._layout = layout
        scene, random = layout.scene, Random(layout.scene.seed)
        add_bowl(layout)
        add_surroundings(layout, random)
        self._needle = add_needle(scene.needle)
        second = layout.second_instrument()
        if scene.second_instrument and second:
            add_second_instrument(scene.second_instrument, *second, layout)
        add_beads(layout, random)
        for light in scene.lights:
            _add_light(light)
        _add_ambient_light(scene.ambient)
        _add_camera(scene.camera.px_per_mm)
        _set_up_cycles(scene.camera.filter_px, scene.camera.exposure_stops)

    def render(self, file: Path, pose: Pose | None, box_px: Box | None = None, smaller: int = 1) -> None:
        """Render an image, or a part of it.

        The image has full size, black where it was not rendered; WebP holds the part alone, without loss.

        Args:
            file: The PNG or WebP file to write; it appears when it is complete.
            pose: Pose of the needle; None: no needle.
            box_px: Left, top, right and bottom of the part; None: all.
            smaller: The image is rendered at this fraction of its size.
        """
        settings = bpy.context.scene.render
        self._needle.hide_render = pose is None
        settings.use_border, settings.use_crop_to_border = box_px is not None, file.suffix == ".webp"
        settings.image_settings.file_format = "WEBP" if file.suffix == ".webp" else "PNG"
        settings.image_settings.quality, settings.resolution_percentage = 100, 100 // smaller
        if pose is not None:
            placed, roll_deg = self._layout.placed(pose), self._layout.scene.needle.roll_deg
            place(self._needle, self._layout, placed.axis_mm, placed.direction, roll_deg or 0.0)
        if box_px is not None:
            left, top, right, bottom = box_px
            settings.border_min_x, settings.border_max_x = left / WIDTH_PX, right / WIDTH_PX
            settings.border_min_y, settings.border_max_y = 1 - bottom / HEIGHT_PX, 1 - top / HEIGHT_PX
        part = file.with_name(f"part{file.suffix}")
        settings.filepath = str(part)
        with silence():
            bpy.ops.render.render(write_still=True)
        part.replace(file)


def _add_light(light: Light) -> None:
    area = bpy.data.lights.new("light", "AREA")
    area.size, area.energy = light.size_mm, LIGHT_W * light.strength
    towards = Vector(light.towards).normalized()
    lamp = add("light", area)
    lamp.location = towards * LIGHT_MM
    lamp.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()


def _add_ambient_light(strength: float) -> None:
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = strength
    bpy.context.scene.world = world


def _add_camera(px_per_mm: float) -> None:
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit, camera.sensor_width = "HORIZONTAL", SENSOR_MM
    camera.lens = SENSOR_MM * DISTANCE_MM * px_per_mm / WIDTH_PX
    camera.clip_end = 2000
    added = add("camera", camera)
    added.location, added.rotation_euler = (0, -DISTANCE_MM, 0), (math.pi / 2, 0, 0)
    bpy.context.scene.camera = added


def add(name: str, data: bpy.types.ID) -> bpy.types.Object:
    """Add an object with some data to the scene."""
    added = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(added)
    return added


def _set_up_cycles(filter_px: float, exposure_stops: float) -> None:
    scene = bpy.context.scene
    scene.view_settings.view_transform, scene.view_settings.exposure = "Standard", exposure_stops
    settings = scene.render
    settings.engine = "CYCLES"
    settings.use_persistent_data = True  # static objects are prepared once
    settings.resolution_x, settings.resolution_y = WIDTH_PX, HEIGHT_PX
    settings.image_settings.color_mode = "RGB"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed = "CPU", SAMPLES, 1
    cycles.use_denoising, cycles.denoiser = True, "OPENIMAGEDENOISE"
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 4, 2, 2
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", filter_px


@contextmanager
def silence() -> Iterator[None]:
    """Suppress Blender's line per tile, which bypasses Python's stdout."""
    stdout, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        os.dup2(stdout, 1)
        os.close(stdout)
        os.close(null)
