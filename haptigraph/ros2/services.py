"""Call services of ROS 2 nodes over plain DDS: a request on rq/NAMERequest -> the reply on rr/NAMEReply.

Middlewares do not agree on how a reply says which request it answers: Cyclone DDS puts a header before both
messages, Fast DDS sends that outside of them, where Cyclone cannot read it
(https://github.com/ros2/rmw_cyclonedds/issues/184). The server's GUID shows which of the two it uses.
"""

import queue
import threading
import time
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from cyclonedds.core import DDSException
from cyclonedds.idl import IdlStruct, make_idl_struct, types
from cyclonedds.idl.annotations import autoid, final
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from haptigraph.ros2.node import Node, checked_topic
from haptigraph.ros2.qos import SERVICE

__all__ = ["CYCLONE", "Service", "ServiceCalls"]

CYCLONE = b"\x01\x10"
"""The vendor of Eclipse Cyclone DDS, with which a GUID begins (RTPS 2.5, 8.4.2.3)."""
TICK_S = 0.02
RESEND_S = 0.5
TIMEOUT_S = 5.0
CLOSE_TIMEOUT_S = 1.0


class Service(NamedTuple):
    """The type of a service."""

    request: type[IdlStruct]
    reply: type[IdlStruct]


class ServiceCalls:
    """Call services one after another in a thread of its own, so that nobody waits.

    Args:
        node: The participant that calls.
        report: Called with the problem of a call that failed or was refused.
    """

    def __init__(self, node: Node, report: Callable[[str], None]) -> None:
        self._node, self._report = node, report
        self._waiting: queue.SimpleQueue[tuple[str, Service, tuple[Any, ...]] | None] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="haptigraph-ros2-services", daemon=True)
        self._thread.start()

    def put(self, name: str, service: Service, *values: Any) -> None:
        """Call a service whose reply has the field `success`, after those before."""
        self._waiting.put((name, service, values))

    def close(self) -> None:
        """Give up calls that have not been answered. May be called twice."""
        self._closing.set()
        self._waiting.put(None)
        self._thread.join(CLOSE_TIMEOUT_S)

    def _run(self) -> None:
        while (waiting := self._waiting.get()) is not None and not self._closing.is_set():
            name, service, values = waiting
            try:
                reply = _call(self._node, name, service, values, self._closing)
                if not reply.success:
                    self._report(f"{name} refused {', '.join(map(str, values))}")
            except Exception as error:  # no call may end this thread
                if not self._closing.is_set():
                    self._report(str(error) or type(error).__name__)


def _call(node: Node, name: str, service: Service, values: tuple[Any, ...], closing: threading.Event) -> Any:
    """Call a service and wait for its reply. The request may be sent more than once.

    With Fast DDS, another client's reply at that time cannot be distinguished from the own one.

    Args:
        node: The participant that calls.
        name: ROS name of the service.
        service: Its type.
        values: The fields of the request.
        closing: Set it to give up.

    Raises:
        OSError: If there is no server, or no reply.
    """
    full, until_s = checked_topic(name), time.monotonic() + TIMEOUT_S
    while not (servers := node.dds_subscribers(f"rq{full}Request")):
        _tick(closing, until_s, f"no node offers the service {full}")
    has_header = servers[0].vendor == CYCLONE
    request, reply = (_with_header(kind) if has_header else kind for kind in service)
    try:
        asked = Topic(node.participant, f"rq{full}Request", request)
        answered = Topic(node.participant, f"rr{full}Reply", reply)
        writer: DataWriter[Any] = DataWriter(node.participant, asked, qos=SERVICE.qos)
        reader: DataReader[Any] = DataReader(node.participant, answered, qos=SERVICE.qos)
        header = (int.from_bytes(writer.guid.bytes[8:], "little"), 1) if has_header else ()
        sent_s = 0.0
        while True:
            for answer in reader.take(N=1):
                if isinstance(answer, InvalidSample):  # which announces that a server has left
                    continue
                if not has_header or (answer.guid, answer.number) == header:
                    return answer
            is_due = time.monotonic() - sent_s > RESEND_S
            if is_due and _count(writer, "publication") and _count(reader, "subscription"):
                writer.write(request(*header, *values))
                sent_s = time.monotonic()
            _tick(closing, until_s, f"the service {full} does not answer")
    except DDSException as error:
        raise OSError(f"{full}: {error.msg}") from None


def _tick(closing: threading.Event, until_s: float, problem: str) -> None:
    if closing.wait(TICK_S) or time.monotonic() > until_s:
        raise OSError(problem)


def _count(entity: Any, kind: str) -> int:
    return int(getattr(entity, f"get_{kind}_matched_status")().current_count)


@cache
def _with_header(kind: type[IdlStruct]) -> type[IdlStruct]:
    """Return a type with Cyclone's header before its fields: who sent the request, and its number."""
    fields = {"guid": types.uint64, "number": types.int64, **kind.__annotations__}
    name = kind.__idl_typename__
    return autoid("sequential")(final(make_idl_struct(kind.__name__, name, fields)))
