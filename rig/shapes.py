"""Simple solids by the coordinates that a drawing would give [mm]."""

from collections.abc import Sequence

from build123d import Align, Box, Cylinder, Location, Part, Plane, Polygon, Pos, Sphere, extrude

__all__ = ["ball", "block", "moved", "prism", "rod", "slab"]

Range = tuple[float, float]
Point = Sequence[float]


def block(x_mm: Range, y_mm: Range, z_mm: Range) -> Part:
    """Return a box between coordinates."""
    sides = (x_mm, y_mm, z_mm)
    center = [(low + high) / 2 for low, high in sides]
    return Pos(*center) * Box(*(high - low for low, high in sides))


def rod(start_mm: Point, end_mm: Point, diameter_mm: float) -> Part:
    """Return a cylinder between two points."""
    way = [end - start for start, end in zip(start_mm, end_mm, strict=True)]
    length_mm = sum(side**2 for side in way) ** 0.5
    low = (Align.CENTER, Align.CENTER, Align.MIN)
    plane = Plane(origin=tuple(start_mm), z_dir=tuple(way))
    return Part() + plane * Cylinder(diameter_mm / 2, length_mm, align=low)


def ball(radius_mm: float) -> Part:
    """Return a sphere around the eye's centre."""
    return Part() + Sphere(radius_mm)


def prism(outline_mm: Sequence[Range], plane: Plane, low_mm: float, high_mm: float) -> Part:
    """Return an outline in a plane's coordinates, extruded between two distances from it."""
    face = Polygon(*outline_mm, align=None)
    return Part() + plane * Pos(0, 0, low_mm) * extrude(face, high_mm - low_mm, dir=(0, 0, 1))


def slab(plane: Plane, right_mm: Range, up_mm: Range, out_mm: Range) -> Part:
    """Return a box in a plane's coordinates."""
    return Part() + plane * block(right_mm, up_mm, out_mm)


def moved(part: Part, x_mm: float, y_mm: float, z_mm: float) -> Part:
    """Return a shifted copy."""
    return part.moved(Location((x_mm, y_mm, z_mm)))
