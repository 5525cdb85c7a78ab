"""The assembled rig -> labelled pictures (PNG), by VTK off screen: whole, inside, light path, eye, parts."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import PIL.Image
import pyvista as pv
import trimesh
from matplotlib.figure import Figure
from msgspec import Struct
from numpy.typing import NDArray

from rig.assembly import Body
from rig.layout import Layout

__all__ = ["write_pictures"]

SIZE_PX, PART_PX = (1100, 800), (420, 320)
DPI = 100
COLORS = {
    "eye": "#f4f1ea",
    "retina": "#e2703a",
    "target": "#20304f",
    "frame": "#7f93a8",
    "camera_mount": "#5f9c90",
    "camera_clamp": "#8cc2b6",
    "camera": "#2b2e33",
    "light": "#d3ae57",
    "base": "#aab4bf",
    "mirror_mount": "#8d79b3",
    "mirror": "#cfe3f2",
    "mask": "#e8bf9f",
    "post": "#98a4b0",
    "led": "#fff4c2",
    "screw": "#4a4d52",
    "clip": "#5f9c90",
    "motor": "#c7ccd1",
    "stylus": "#3a3f46",
}
INK, RAY = "#1f2933", "#d7263d"
LABELS = {"post_2": "post (4)", "post_4": "post (4)", "led_1": "LED (8)"}
PARTS_ACROSS = 4
LABEL_SAMPLES, LABEL_MM = 400, 0.5
TONES = 128


class View(Struct, frozen=True):
    """From where a picture is taken, and what it shows."""

    name: str
    towards: tuple[float, float, float]
    """From the middle to the camera."""
    labels: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    apart: Mapping[str, tuple[float, float, float]] = {}
    """By kind: how far a body is moved for an exploded view [mm]."""
    see_through: tuple[str, ...] = ()
    rays: bool = False
    zoom: float = 1.0


VIEWS = (
    View("assembly", (-0.45, 1.15, 0.8), ("mask", "eye", "post_4", "base"), zoom=1.2),
    View(
        "inside",
        (-1.0, 0.5, -0.25),
        (
            "eye",
            "retina",
            "frame",
            "light",
            "mirror",
            "mirror_mount",
            "camera",
            "camera_mount",
            "base",
            "post_2",
        ),
        without=("mask",),
        see_through=("mirror_mount", "post"),
        zoom=1.2,
    ),
    View(
        "light_path",
        (-1, 0.12, 0.0),
        ("eye", "mirror", "camera", "light", "frame"),
        without=("mask", "post"),
        see_through=("mirror_mount", "light", "camera_mount", "camera_clamp"),
        rays=True,
        zoom=1.25,
    ),
    View(
        "eye_exploded",
        (0.7, 0.35, 1.0),
        ("eye", "retina", "target"),
        only=("eye", "retina", "target"),
        apart={"retina": (0, -2, 16), "target": (0, -2, 26)},
        zoom=1.05,
    ),
    View("eye_front", (0.0, 0.0, 1.0), ("eye", "retina", "target"), only=("eye", "retina", "target")),
    View("clip", (0.8, 0.7, 0.9), ("clip", "motor", "stylus"), only=("clip", "motor", "stylus"), zoom=1.1),
)


def write_pictures(
    layout: Layout, bodies: list[Body], meshes: Mapping[str, trimesh.Trimesh], folder: Path
) -> None:
    """Render all pictures: one a view, and one of all printed parts.

    Args:
        layout: The layout.
        bodies: All bodies.
        meshes: Their meshes by name, in the eye frame.
        folder: Where to write; it exists.
    """
    for view in VIEWS:
        image, places = _rendered(layout, view, bodies, meshes, SIZE_PX)
        _write_labelled(image, places, folder / f"{view.name}.png")
    kinds = sorted({body.kind for body in bodies if body.print})
    views = [View(kind, (-0.6, 0.6, 1.0), only=(kind,), zoom=0.9) for kind in kinds]
    images = [_rendered(layout, view, bodies, meshes, PART_PX)[0] for view in views]
    _write_sheet(images, kinds, folder / "parts.png")


def _rendered(
    layout: Layout,
    view: View,
    bodies: Iterable[Body],
    meshes: Mapping[str, trimesh.Trimesh],
    size_px: tuple[int, int],
) -> tuple[NDArray[np.uint8], dict[str, tuple[float, float]]]:
    """Return an image, and where in it the labelled bodies are (from the top left)."""
    plotter = pv.Plotter(off_screen=True, window_size=list(size_px), lighting="none")
    plotter.set_background("#ffffff", top="#eef2f6")
    shown = {}
    for body in bodies:
        if not _is_shown(body, view):
            continue
        mesh = meshes[body.name].copy()
        mesh.apply_translation(view.apart.get(body.kind, (0, 0, 0)))
        plotter.add_mesh(
            pv.wrap(mesh).compute_normals(feature_angle=30, split_vertices=True),
            color=COLORS[body.kind],
            smooth_shading=True,
            ambient=0.25,
            diffuse=0.8,
            specular=0.5 if body.kind in ("mirror", "motor", "screw") else 0.12,
            specular_power=20,
            opacity=0.2 if body.kind in view.see_through else 1.0,
        )
        shown[body.name] = mesh
    if view.rays:
        _add_rays(plotter, layout)
    for position, strength in (((-250, 400, 350), 0.7), ((350, 200, 250), 0.35), ((-200, 100, -300), 0.3)):
        plotter.add_light(pv.Light(position=position, intensity=strength, light_type="scene light"))
    low, high = (np.array(plotter.bounds)[i::2] for i in (0, 1))
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    towards = np.array(view.towards) / np.linalg.norm(view.towards)
    plotter.camera.view_angle = 20
    eye = middle + 2.7 * size / view.zoom * towards
    plotter.camera_position = [eye, middle, (0, 1, 0)]
    plotter.enable_ssao(radius=0.05 * size, bias=0.004 * size, kernel_size=32)
    plotter.enable_anti_aliasing("msaa", multi_samples=8)
    image = plotter.screenshot(return_img=True)
    places = {name: _in_image(plotter, point, size_px) for name, point in _visible(shown, view, eye).items()}
    plotter.close()
    return np.asarray(image), places


def _is_shown(body: Body, view: View) -> bool:
    if view.only:
        return body.kind in view.only and (body.kind != "post" or body.name == "post_1")
    return body.group == "rig" and body.kind not in view.without


def _visible(
    shown: Mapping[str, trimesh.Trimesh], view: View, eye: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return a point in the middle of what is visible of each labelled body."""
    opaque = [
        mesh for name, mesh in shown.items() if name.rstrip("0123456789").rstrip("_") not in view.see_through
    ]
    scene, found = trimesh.util.concatenate(opaque), {}
    for name in (name for name in view.labels if name in shown):
        points, _ = trimesh.sample.sample_surface(shown[name], LABEL_SAMPLES, seed=1)
        way = points - eye
        distance = np.linalg.norm(way, axis=1)
        _, ray, where = scene.ray.intersects_id(
            np.broadcast_to(eye, points.shape),
            way / distance[:, None],
            multiple_hits=False,
            return_locations=True,
        )
        free = np.ones(len(points), bool)
        free[ray] = np.linalg.norm(where - eye, axis=1) > distance[ray] - LABEL_MM
        if free.any():
            middle = points[free].mean(axis=0)
            found[name] = points[free][np.argmin(np.linalg.norm(points[free] - middle, axis=1))]
    return found


def _in_image(
    plotter: pv.Plotter, point: NDArray[np.float64], size_px: tuple[int, int]
) -> tuple[float, float]:
    renderer = plotter.renderer
    renderer.SetWorldPoint(*point, 1.0)
    renderer.WorldToDisplay()
    x, y, _ = renderer.GetDisplayPoint()
    return x, size_px[1] - y


def _add_rays(plotter: pv.Plotter, layout: Layout) -> None:
    """Add the rays from the rim of the globe to the pupil."""
    slope = 0.5**0.5
    for angle in np.linspace(0, 2 * np.pi, 16, endpoint=False):
        start = layout.radius_mm * np.array([np.cos(angle), np.sin(angle), 0.0])
        points = [start]
        if layout.mirror:
            normal, middle = np.array([0, slope, slope]), layout.mirror_center_mm
            way = layout.rig.path_mm * np.array([0, 0, 1.0]) - start
            points.append(start + ((middle - start) @ normal) / (way @ normal) * way)
        points.append(layout.camera.pupil_mm)
        plotter.add_mesh(pv.MultipleLines(np.array(points)), color=RAY, line_width=2, lighting=False)


def _write_labelled(image: NDArray[np.uint8], places: dict[str, tuple[float, float]], file: Path) -> None:
    """Write an image with labels at its sides and lines to the bodies."""
    height, width = image.shape[:2]
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(image)
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.axis("off")
    for is_left in (True, False):
        side = sorted((y, x, name) for name, (x, y) in places.items() if (x < width / 2) == is_left)
        for row, (y, x, name) in enumerate(side):
            at_y = height * (row + 1) / (len(side) + 1) if len(side) > 2 else y
            at = (14 if is_left else width - 14, at_y)
            axes.annotate(
                LABELS.get(name, name.replace("_", " ")),
                (x, y),
                at,
                fontsize=11,
                color=INK,
                ha="left" if is_left else "right",
                va="center",
                arrowprops={"arrowstyle": "-", "lw": 0.8, "color": INK, "shrinkB": 0},
                bbox={"boxstyle": "round,pad=0.25", "fc": "white", "ec": "#c8d0d8", "lw": 0.6},
            )
            axes.plot(x, y, "o", ms=3.5, color=INK)
    _save(figure, file)


def _write_sheet(images: list[NDArray[np.uint8]], names: list[str], file: Path) -> None:
    """Write all parts on one sheet, each with its name."""
    rows = -(-len(images) // PARTS_ACROSS)
    width, height = PART_PX
    figure = Figure(figsize=(PARTS_ACROSS * width / DPI, rows * height / DPI), dpi=DPI)
    for index, (image, name) in enumerate(zip(images, names, strict=True)):
        row, column = divmod(index, PARTS_ACROSS)
        axes = figure.add_axes((column / PARTS_ACROSS, 1 - (row + 1) / rows, 1 / PARTS_ACROSS, 1 / rows))
        axes.imshow(image)
        axes.axis("off")
        axes.text(14, 26, name.replace("_", " "), fontsize=11, color=INK, weight="bold")
    _save(figure, file)


def _save(figure: Figure, file: Path) -> None:
    """Write a figure as a small PNG."""
    figure.savefig(file, dpi=DPI)
    with PIL.Image.open(file) as image:
        small = image.convert("RGB").quantize(TONES)
    small.save(file, optimize=True)
