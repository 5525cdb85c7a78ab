"""Export a recorded run as MCAP with Protobuf messages: Foxglove's own schemas, and `haptigraph.Step`.

Viewers that know no JSON schema (Rerun) open it, and others without a panel for JSON. Every column of the
exported table is a field of `haptigraph.Step`; an unknown number is NaN, any other unknown value is not set.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from haptigraph.analysis.exporting.columns import Column, Row, RunTable
from haptigraph.errors import MissingExtra
from haptigraph.recording.entries import entries
from haptigraph.recording.schema import TOPICS
from haptigraph.recording.writer import Progress

if TYPE_CHECKING:
    from google.protobuf.message import Message

__all__ = ["STEP_TOPIC", "run_foxglove"]

STEP_TOPIC = "/step"
METADATA = "haptigraph.export"
"""Not that of a recording, which replays."""
WELL_KNOWN = {topic.name: topic.schema for topic in TOPICS if topic.schema.startswith("foxglove.")}
TIME_FIELDS = {"sec": "seconds", "nsec": "nanos"}
"""Protobuf's names of them."""


def run_foxglove(path: str | Path, output: str | Path, progress: Progress | None, name: str) -> None:
    """Write one recorded run for Foxglove and Rerun.

    Args:
        path: The recording.
        output: The MCAP file to write.
        progress: Called with the number of steps written.
        name: What the field `recording` says.

    Raises:
        BadInput: If the recording cannot be read.
        MissingExtra: If the libraries of Foxglove's schemas are not installed.
    """
    try:
        from mcap_protobuf.writer import Writer  # noqa: PLC0415 - optional
    except ModuleNotFoundError:
        raise MissingExtra("an export for Foxglove", "foxglove") from None
    table = RunTable(path, name)
    info, columns = table.reader.info, [column for column in table.columns if column.name != "utc"]
    step_message, well_known = _step_message(columns), _well_known()
    with Path(output).open("wb") as file, Writer(file) as writer:
        header = {"version": info.version, "procedure": info.procedure, "registration": info.registration}
        writer.add_metadata(METADATA, header)
        for count, row in enumerate(table.rows(images=True), 1):
            utc_ns = row.step.stamp_ns + info.utc_offset_ns
            image = table.registration.image
            for topic, message in entries(
                row.capture, row.step, image=image, utc_offset_ns=info.utc_offset_ns
            ):
                if topic in well_known:
                    encoded = well_known[topic](
                        **_protobuf(msgspec.to_builtins(message, builtin_types=(bytes,)))
                    )
                    writer.write_message(topic, encoded, utc_ns, utc_ns, row.number)
            writer.write_message(STEP_TOPIC, _step(step_message, columns, row), utc_ns, utc_ns, row.number)
            if progress is not None:
                progress("writing", count, 0)


def _well_known() -> dict[str, Callable[..., "Message"]]:
    """Return the class of every topic that has a schema of Foxglove's.

    Raises:
        MissingExtra: If the schemas are not installed.
    """
    try:
        from foxglove_schemas_protobuf import (  # noqa: PLC0415 - optional
            CompressedImage_pb2,
            ImageAnnotations_pb2,
            Log_pb2,
            PosesInFrame_pb2,
        )
    except ModuleNotFoundError:
        raise MissingExtra("an export for Foxglove", "foxglove") from None
    modules = (CompressedImage_pb2, ImageAnnotations_pb2, Log_pb2, PosesInFrame_pb2)
    classes = {f"foxglove.{name}": getattr(module, name) for module in modules for name in _messages(module)}
    return {topic: classes[schema] for topic, schema in WELL_KNOWN.items()}


def _messages(module: Any) -> list[str]:
    return list(module.DESCRIPTOR.message_types_by_name)


def _protobuf(value: Any) -> Any:
    """Return a message of the recording with the names of Protobuf's time stamps."""
    if isinstance(value, dict):
        return {TIME_FIELDS.get(key, key): _protobuf(each) for key, each in value.items()}
    return [_protobuf(each) for each in value] if isinstance(value, (list, tuple)) else value


def _step(message: Callable[..., "Message"], columns: Sequence[Column], row: Row) -> "Message":
    values = {column.name: column.value(row) for column in columns}
    unknown = {column.name: float("nan") for column in columns if column.kind == "number"}
    return message(**unknown | {name: value for name, value in values.items() if value is not None})


def _step_message(columns: Sequence[Column]) -> Callable[..., "Message"]:
    """Return the class of `haptigraph.Step` with a field for every column."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory  # noqa: PLC0415 - optional

    field = descriptor_pb2.FieldDescriptorProto
    types = {
        "text": field.TYPE_STRING,
        "texts": field.TYPE_STRING,
        "integer": field.TYPE_INT64,
        "number": field.TYPE_DOUBLE,
    }
    file = descriptor_pb2.FileDescriptorProto(
        name="haptigraph/step.proto", package="haptigraph", syntax="proto3"
    )
    message = file.message_type.add(name="Step")
    for number, column in enumerate(columns, 1):
        added = message.field.add(name=column.name, number=number, type=types[column.kind])
        added.label = field.LABEL_REPEATED if column.kind == "texts" else field.LABEL_OPTIONAL
        if column.kind in ("text", "integer"):  # of which 0 and "" would be values
            added.proto3_optional = True
            added.oneof_index = len(message.oneof_decl)
            message.oneof_decl.add(name=f"_{column.name}")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    made: Callable[..., Message] = message_factory.GetMessageClass(
        pool.FindMessageTypeByName("haptigraph.Step")
    )
    return made
