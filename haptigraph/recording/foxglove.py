"""The Foxglove messages of a recording, so that Foxglove shows images, annotations and faults as they are.

Field names follow the published schemas (https://docs.foxglove.dev/docs/visualization/message-schemas).
"""

import math
from collections.abc import Sequence
from typing import Any

import msgspec
from msgspec import Struct

from haptigraph.geometry import Circle, Geometry, Point, Polyline, Segment, Vec
from haptigraph.messages import RobotSample
from haptigraph.projection import ImageGeometry

__all__ = [
    "CompressedImage",
    "ImageAnnotations",
    "Log",
    "PosesInFrame",
    "Time",
    "annotations",
    "encode_message",
    "foxglove_schema",
    "robot_poses",
]

LINE_STRIP = 3
INFO, WARNING = 2, 3
ROBOT_FRAME = "robot_base"
MM_PER_M = 1000.0


class Time(Struct, frozen=True):
    """Wall-clock time."""

    sec: int
    nsec: int

    @classmethod
    def from_ns(cls, utc_ns: int) -> "Time":
        """Split nanoseconds since 1970."""
        return cls(*divmod(utc_ns, 1_000_000_000))


class Color(Struct, frozen=True):
    """A colour, each component in [0, 1]."""

    r: float
    g: float
    b: float
    a: float = 1.0


class Point2(Struct, frozen=True):
    """A position in an image [px]."""

    x: float
    y: float


class CompressedImage(Struct, frozen=True):
    """foxglove.CompressedImage."""

    timestamp: Time
    frame_id: str
    data: bytes
    format: str


class CircleAnnotation(Struct, frozen=True):
    """foxglove.CircleAnnotation."""

    timestamp: Time
    position: Point2
    diameter: float
    thickness: float
    fill_color: Color
    outline_color: Color


class PointsAnnotation(Struct, frozen=True):
    """foxglove.PointsAnnotation."""

    timestamp: Time
    type: int
    points: tuple[Point2, ...]
    outline_color: Color
    outline_colors: tuple[Color, ...]
    fill_color: Color
    thickness: float


class TextAnnotation(Struct, frozen=True):
    """foxglove.TextAnnotation."""

    timestamp: Time
    position: Point2
    text: str
    font_size: float
    text_color: Color
    background_color: Color


class ImageAnnotations(Struct, frozen=True):
    """foxglove.ImageAnnotations."""

    circles: tuple[CircleAnnotation, ...]
    points: tuple[PointsAnnotation, ...]
    texts: tuple[TextAnnotation, ...]


class Log(Struct, frozen=True):
    """foxglove.Log."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


class Vector3(Struct, frozen=True):
    """foxglove.Vector3."""

    x: float
    y: float
    z: float


class Rotation(Struct, frozen=True):
    """foxglove.Quaternion."""

    x: float
    y: float
    z: float
    w: float


class Pose(Struct, frozen=True):
    """foxglove.Pose [m]."""

    position: Vector3
    orientation: Rotation


class PosesInFrame(Struct, frozen=True):
    """foxglove.PosesInFrame."""

    timestamp: Time
    frame_id: str
    poses: tuple[Pose, ...]


INSTRUMENT = Color(0.98, 0.75, 0.18)
ANATOMY = Color(0.35, 0.75, 0.95)
CLEAR = Color(0.0, 0.0, 0.0, 0.0)
DOT_MM = 0.35
FIELDS = msgspec.json.Decoder(dict[str, msgspec.Raw])


def annotations(
    time: Time, found: dict[str, Geometry], image: ImageGeometry, caption: str
) -> ImageAnnotations:
    """Annotate the stored image with the detected geometry; of a volume's, points only, in their B-scans."""
    circles, lines = [], []
    for name, shape in found.items():
        color = INSTRUMENT if name.startswith("needle") else ANATOMY
        if isinstance(shape, Point):
            circles.append(_circle(time, Circle(shape.at_mm, DOT_MM), image, color, shape.z_mm))
        elif isinstance(shape, Circle):
            if image.frontal_from_image is None:
                circles.append(_circle(time, shape, image, color))
            else:
                lines.append(_line(time, _outline(shape), image, color))
        elif isinstance(shape, Polyline | Segment) and image.slices is None:
            points = shape.points_mm if isinstance(shape, Polyline) else (shape.start_mm, shape.end_mm)
            lines.append(_line(time, points, image, color))
    text = TextAnnotation(time, Point2(12.0, 12.0), caption, 20.0, Color(1.0, 1.0, 1.0), Color(0, 0, 0, 0.6))
    return ImageAnnotations(tuple(circles), tuple(lines), (text,))


def robot_poses(samples: Sequence[RobotSample], utc_offset_ns: int) -> PosesInFrame:
    """Return the robot's poses in its base, oldest first, at the time of the newest."""
    poses = tuple(
        Pose(Vector3(*(mm / MM_PER_M for mm in sample.position_mm)), Rotation(*sample.quaternion))
        for sample in samples
    )
    return PosesInFrame(Time.from_ns(samples[-1].stamp_ns + utc_offset_ns), ROBOT_FRAME, poses)


def foxglove_schema(type_: type, title: str) -> dict[str, Any]:
    """Describe a message in the subset of JSON Schema that Foxglove reads.

    The subset has objects, numbers, strings, and lists of these, without references. What it cannot describe
    (unions, lists of lists) is left out of the schema, but not of the message. A field of the message itself
    may be absent (see `encode_message`), so its schema is that of its value.
    """
    components = msgspec.json.schema_components([type_])[1]
    fields = components[type_.__name__]["properties"]
    schema = _plain(
        {"type": "object", "properties": {name: _not_null(field) for name, field in fields.items()}},
        components,
    )
    return {"title": title, **(schema or {})}


def encode_message(message: Struct) -> bytes:
    """Encode a message as JSON that its schema describes: fields that are null are left out."""
    data = msgspec.json.encode(message)
    if b":null" not in data:
        return data
    fields = FIELDS.decode(data)
    return msgspec.json.encode({name: value for name, value in fields.items() if bytes(value) != b"null"})


def _circle(
    time: Time, circle: Circle, image: ImageGeometry, color: Color, z_mm: float = 0.0
) -> CircleAnnotation:
    center = Point2(*image.to_px(circle.center_mm, z_mm))
    return CircleAnnotation(time, center, 2 * circle.radius_mm / image.mm_per_px, 2.0, CLEAR, color)


def _line(time: Time, points_mm: Sequence[Vec], image: ImageGeometry, color: Color) -> PointsAnnotation:
    points = tuple(Point2(*image.to_px(point)) for point in points_mm)
    return PointsAnnotation(time, LINE_STRIP, points, color, (), CLEAR, 2.0)


def _outline(circle: Circle) -> list[Vec]:
    """Return points on a circle that appears as an ellipse in the image."""
    (x, y), radius = circle.center_mm, circle.radius_mm
    angles = [math.radians(angle_deg) for angle_deg in range(0, 361, 5)]
    return [(x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles]


def _not_null(schema: dict[str, Any]) -> dict[str, Any]:
    choices = [choice for choice in schema.get("anyOf", ()) if choice.get("type") != "null"]
    return choices[0] if len(choices) == 1 else schema


def _plain(schema: dict[str, Any], components: dict[str, Any]) -> dict[str, Any] | None:
    """Resolve references and drop what Foxglove does not support."""
    if "$ref" in schema:
        return _plain(components[schema["$ref"].rpartition("/")[2]], components)
    if "enum" in schema:
        return {"type": "string"}
    kind = schema.get("type")
    if kind == "object":
        fields = {name: _plain(field, components) for name, field in schema.get("properties", {}).items()}
        return {"type": "object", "properties": {name: field for name, field in fields.items() if field}}
    if kind == "array":
        inner = schema.get("items") or next(iter(schema.get("prefixItems", ())), None)
        item = _plain(inner, components) if inner else None
        return {"type": "array", "items": item} if item and item["type"] != "array" else None
    if kind == "string":
        encoding = {"contentEncoding": "base64"} if schema.get("contentEncoding") == "base64" else {}
        return {"type": "string", **encoding}
    return {"type": kind} if kind in ("boolean", "number", "integer") else None
