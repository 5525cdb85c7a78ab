"""A printed part -> a drawing on A4 (SVG, PDF): three views as it lies on the bed, dimensions, holes.

Third-angle projection. Overall dimensions, and every full circle that faces a view by diameter and
number; those seen from the top have a table of positions.
"""

from collections import defaultdict
from pathlib import Path

import numpy as np
from build123d import Axis, GeomType, Location, Part, Plane, Vector
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from msgspec import Struct
from numpy.typing import NDArray

from rig.meshes import bed_axes, mesh_of
from rig.standard import Print

__all__ = ["write_drawing"]

A4_MM = (297.0, 210.0)
SCALES = (5.0, 2.0, 1.0, 0.5, 0.4, 0.25, 0.2)
GAP_MM, MARGIN_MM = 18.0, 12.0
SPACE_MM = (180.0, 165.0)  # of the sheet, for the three views
OBLIQUE_MM = 78.0
STEPS = 24
SHARP_RAD, OFF_MM = 0.5, 0.05
MIN_DIAMETER_MM = 1.0
NO_BREAK = "\u00a0"  # SVG collapses spaces
GREY, DIMENSION = "#9aa5b1", "#1d4e89"
LEADER = {"arrowstyle": "-", "lw": 0.4, "color": DIMENSION}

Points = NDArray[np.float64]


class View(Struct, frozen=True):
    """From where a part is seen; `right` and `up` on the sheet."""

    name: str
    out: tuple[float, float, float]
    """Towards the viewer."""
    up: tuple[float, float, float]


TOP, FRONT, RIGHT = (
    View("top", (0, 0, 1), (0, 1, 0)),
    View("front", (0, -1, 0), (0, 0, 1)),
    View("right", (1, 0, 0), (0, 0, 1)),
)
OBLIQUE = View("oblique", (-0.5, -0.7, 0.5), (0, 0, 1))


def write_drawing(name: str, rig_name: str, shape: Part, print_: Print, folder: Path) -> list[Path]:
    """Write NAME.svg and NAME.pdf.

    Args:
        name: The part's name.
        rig_name: The rig's name, for the title.
        shape: The part, in the eye frame.
        print_: How it is printed.
        folder: Where to write; it exists.
    """
    lying = _lying(shape, print_)
    box = lying.bounding_box().size
    scale = next((s for s in SCALES if _fits(box, s)), SCALES[-1])
    sheet = Figure(figsize=(A4_MM[0] / 25.4, A4_MM[1] / 25.4))
    axes = sheet.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, A4_MM[0]), ylim=(0, A4_MM[1]), aspect="equal")
    axes.axis("off")
    width, depth, height = (side * scale for side in (box.X, box.Y, box.Z))
    left, bottom = MARGIN_MM + 16, MARGIN_MM + 14
    places = {
        FRONT: (left, bottom),
        TOP: (left, bottom + height + GAP_MM + 8),
        RIGHT: (left + width + GAP_MM + 8, bottom),
    }
    for view, place in places.items():
        corner = _draw_view(axes, lying, view, place, scale)
        _note_circles(axes, lying, view, place, corner, scale)
    _dimension(axes, (left, bottom - 7), (left + width, bottom - 7), box.X)
    _dimension(axes, (left - 7, bottom), (left - 7, bottom + height), box.Z)
    _dimension(axes, (left - 7, places[TOP][1]), (left - 7, places[TOP][1] + depth), box.Y)
    oblique = min(OBLIQUE_MM / box.length, 2.0)
    _draw_view(axes, lying, OBLIQUE, (208, 132), oblique)
    _write_holes(axes, lying)
    _write_title(axes, name, rig_name, print_, scale)
    axes.plot([6, 291, 291, 6, 6], [6, 6, 204, 204, 6], color="black", linewidth=0.8)
    files = [folder / f"{name}.{ending}" for ending in ("svg", "pdf")]
    with rc_context({"svg.hashsalt": "rig", "svg.fonttype": "none"}):
        sheet.savefig(files[0], metadata={"Date": None})
        sheet.savefig(files[1], metadata={"CreationDate": None})
    return files


def _lying(shape: Part, print_: Print) -> Part:
    """Return the part as it lies on the bed, its lowest corner at the origin."""
    across, _, up = bed_axes(print_)
    plane = Plane(origin=(0, 0, 0), x_dir=tuple(across), z_dir=tuple(up))
    turned = shape.moved(plane.location.inverse())
    low = turned.bounding_box().min
    return turned.moved(Location((-low.X, -low.Y, -low.Z)))


def _fits(box: Vector, scale: float) -> bool:
    across, along = (box.X + box.Y) * scale + GAP_MM + 8, (box.Y + box.Z) * scale + GAP_MM + 8
    return across <= SPACE_MM[0] and along <= SPACE_MM[1]


def _axes_of(view: View) -> tuple[Points, Points]:
    out, up = np.array(view.out, float), np.array(view.up, float)
    out /= np.linalg.norm(out)
    right = np.cross(up, out)
    right /= np.linalg.norm(right)
    return right, np.cross(out, right)


def _draw_view(axes: Axes, shape: Part, view: View, place: tuple[float, float], scale: float) -> Points:
    """Draw the edges, visible ones on hidden ones; return the view's lowest corner in its own coordinates."""
    lines = (
        _mesh_lines(shape, view) if shape.faces().filter_by(GeomType.BSPLINE) else _exact_lines(shape, view)
    )
    low = np.min(np.vstack([line for group in lines for line in group]), axis=0)
    styles = ({"color": GREY, "linewidth": 0.3, "dashes": (4, 2)}, {"color": "black", "linewidth": 0.7})
    for group, style in zip(lines, styles, strict=True):
        if view is OBLIQUE and group is lines[0]:
            continue
        gap = np.full((1, 2), np.nan)  # one line object draws them all
        joined = np.vstack([part for line in group for part in (line, gap)] or [gap])
        x, y = ((joined - low) * scale + place).T
        axes.plot(x, y, solid_capstyle="round", **style)
    return low


def _exact_lines(shape: Part, view: View) -> list[list[Points]]:
    """Return hidden and visible lines."""
    far = tuple(500 * side for side in view.out)
    visible, hidden = shape.project_to_viewport(far, view.up, (0, 0, 0))
    return [[_points(edge) for edge in edges] for edges in (hidden, visible)]


def _mesh_lines(shape: Part, view: View) -> list[list[Points]]:
    """Return hidden and visible outlines and sharp edges of a mesh; exact ones of free forms take minutes."""
    mesh, (right, up) = mesh_of(shape), _axes_of(view)
    out = np.cross(right, up)
    facing = mesh.face_normals @ out > 0
    first, second = facing[mesh.face_adjacency].T
    is_line = (first != second) | (mesh.face_adjacency_angles > SHARP_RAD)
    ends = mesh.vertices[mesh.face_adjacency_edges[is_line]]
    normals = mesh.face_normals[mesh.face_adjacency[is_line]].sum(axis=1)
    middles = ends.mean(axis=1) + OFF_MM * normals
    is_hidden = mesh.ray.intersects_any(middles, np.broadcast_to(out, middles.shape))
    flat = ends @ np.column_stack([right, up])
    return [list(flat[is_hidden]), list(flat[~is_hidden])]


def _points(edge: object) -> Points:
    steps = 2 if edge.geom_type == GeomType.LINE else STEPS  # type: ignore[attr-defined]
    return np.array([tuple(edge.position_at(share))[:2] for share in np.linspace(0, 1, steps)])  # type: ignore[attr-defined]


def _circles(shape: Part, view: View) -> dict[float, list[Points]]:
    """Return the centres of full circles that face a view, by diameter [mm]."""
    right, up = _axes_of(view)
    found: dict[float, list[Points]] = defaultdict(list)
    for edge in shape.edges().filter_by(GeomType.CIRCLE):
        is_facing = edge.is_closed and Axis((0, 0, 0), view.out).is_parallel(
            Axis((0, 0, 0), edge.normal()), 1.0
        )
        diameter = round(2 * edge.radius, 2)
        if not is_facing or diameter < MIN_DIAMETER_MM:
            continue
        center = np.array(tuple(edge.arc_center))
        point = np.round([center @ right, center @ up], 2)
        if not any(np.allclose(point, other) for other in found[diameter]):
            found[diameter].append(point)
    return dict(found)


def _note_circles(
    axes: Axes, shape: Part, view: View, place: tuple[float, float], corner: Points, scale: float
) -> None:
    top = max((float(p[1]) for points in _circles(shape, view).values() for p in points), default=0.0)
    for row, (diameter, points) in enumerate(sorted(_circles(shape, view).items())):
        for point in points:
            x, y = (point - corner) * scale + place
            axes.plot([x - 1.2, x + 1.2], [y, y], color=DIMENSION, linewidth=0.25)
            axes.plot([x, x], [y - 1.2, y + 1.2], color=DIMENSION, linewidth=0.25)
        point = max(points, key=lambda p: (p[1], p[0]))
        x, y = (point - corner) * scale + place
        at = (x + 7 + 2 * row, (top - corner[1]) * scale + place[1] + 9 + 4 * row)
        text = f"{len(points)} x Ø{diameter:g}" if len(points) > 1 else f"Ø{diameter:g}"
        axes.annotate(
            text,
            (x, y),
            at,
            fontsize=6,
            color=DIMENSION,
            arrowprops=LEADER,
        )


def _dimension(axes: Axes, start: tuple[float, float], end: tuple[float, float], length_mm: float) -> None:
    upright = start[0] == end[0]
    style = {
        "arrowstyle": "<->",
        "lw": 0.5,
        "color": DIMENSION,
        "shrinkA": 0,
        "shrinkB": 0,
        "mutation_scale": 6,
    }
    axes.annotate("", start, end, arrowprops=style)
    middle = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    axes.text(
        *middle,
        f"{length_mm:.2f}".rstrip("0").rstrip("."),
        fontsize=7,
        color=DIMENSION,
        ha="center",
        va="center",
        rotation=90 if upright else 0,
        backgroundcolor="white",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
    )


def _write_holes(axes: Axes, shape: Part) -> None:
    """Write the positions of the circles seen from above, from the lower left corner of that view."""
    at: dict[tuple[float, float], list[float]] = defaultdict(list)
    for diameter, points in sorted(_circles(shape, TOP).items()):
        for x, y in points:
            at[float(x), float(y)].append(diameter)
    if not at:
        return
    lines = ["circles seen from the top", f"{'x':>7} {'y':>7}  Ø   [mm]"]
    lines += [
        f"{x:7.2f} {y:7.2f}  {', '.join(f'{one:g}' for one in found)}" for (x, y), found in sorted(at.items())
    ]
    axes.text(236, 128, "\n".join(lines).replace(" ", NO_BREAK), fontsize=5, family="monospace", va="top")


def _write_title(axes: Axes, name: str, rig_name: str, print_: Print, scale: float) -> None:
    ratio = f"{scale:g}:1" if scale >= 1 else f"1:{1 / scale:g}"
    lines = [
        f"{name.replace('_', ' ')}  -  {rig_name}",
        f"scale {ratio}, mm, third angle, as it lies on the bed",
        f"{print_.material}, {print_.color}",
        f"layers {print_.layer_mm:g} mm, infill {print_.infill_percent:g} %",
        f"supports: {print_.supports or 'none'}",
    ]
    axes.plot([205, 205, 291], [6, 30, 30], color="black", linewidth=0.5)
    axes.text(207, 28, lines[0], fontsize=7, weight="bold", va="top")
    axes.text(207, 23, "\n".join(lines[1:]), fontsize=5, va="top")
