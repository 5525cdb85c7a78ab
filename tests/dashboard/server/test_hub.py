"""The hub between loop and viewers: newest image only, never waits, sends retained messages to late viewers."""

import asyncio
import json
import threading
from types import SimpleNamespace

import numpy as np
import pytest
from event_loop import run_in_thread
from helpers import LOW, MS, make_step

from haptigraph.analysis.metrics.run import RunMeasures
from haptigraph.analysis.metrics.temporal import Monitor
from haptigraph.clock import VirtualClock
from haptigraph.dashboard.server.controls import Controls
from haptigraph.dashboard.server.health import Health
from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.viewer import MAX_IN_FLIGHT, Viewer
from haptigraph.inference.claims import Temporal
from haptigraph.messages import OFF, Capture, Fault
from haptigraph.perception.eye_view import IoctView
from haptigraph.run_report import RunReport
from haptigraph.sources.phased import PhasedSource
from haptigraph.sources.teleop import TeleopSource
from haptigraph.teleop.motion import HandMotion, TeleopSettings
from haptigraph.teleop.teleop import Teleop


def capture(index=0):
    return Capture(index, index * MS, np.zeros((240, 320, 3), np.uint8))


@pytest.fixture
def hub(registration):
    hub = Hub(VirtualClock())
    hub.announce({}, IoctView(registration, 64), frozenset())
    return hub


def test_a_fault_is_reported_until_it_is_over_or_another_run_begins(hub, registration):
    def last_faults(*faults):
        hub.write(capture(), make_step(stamp_ns=5 * MS, faults=faults))
        return hub.last_faults

    lost, back = Fault("device", "gone"), Fault("device", "responds again", is_over=True)
    assert last_faults(lost, Fault("guard", "paused")) == {"device": (5.0, "gone"), "guard": (5.0, "paused")}
    assert last_faults() == last_faults(back, lost)
    assert last_faults(lost, back) == {"guard": (5.0, "paused")}
    hub.announce({}, IoctView(registration, 64), frozenset())
    assert hub.last_faults == {}


def pumped(hub, act):
    """Run `await act()` while the hub serves its viewers."""

    async def main():
        pump = asyncio.create_task(hub.pump(lambda: {"steps": 1}))
        await asyncio.sleep(0)
        try:
            return await asyncio.wait_for(act(), 10)
        finally:
            pump.cancel()
            await asyncio.gather(pump, return_exceptions=True)

    return run_in_thread(main())


async def next_image(viewer):
    while isinstance(message := await viewer.next(), str):
        continue
    length = int.from_bytes(message[:4], "big")
    return json.loads(message[4 : 4 + length])


async def next_text(viewer, kind):
    while True:
        message = await viewer.next()
        if isinstance(message, str) and json.loads(message)["type"] == kind:
            return json.loads(message)


def test_health_reports_broken_claims_about_time(hub):
    claim = Temporal("calm", most_changes=2, in_ms=1000)
    measures = RunMeasures(monitors=[Monitor(claim)])
    health = Health(
        SimpleNamespace(report=RunReport(), source=SimpleNamespace(rate_hz=30), sinks=()), hub, measures
    )
    for index in range(3):
        measures.add(make_step(stamp_ns=index * MS, pattern=(LOW, OFF)[index % 2]))
    assert health()["broken"] == []
    for index in range(3, 6):
        measures.add(make_step(stamp_ns=index * MS, pattern=(LOW, OFF)[index % 2]))
    assert health()["broken"] == [{"claim": "calm", "times": 1, "worst": 5, "unit": "changes"}]


def test_a_viewer_gets_the_newest_step_only(hub):
    async def act():
        viewer = Viewer("page 1")
        hub.join(viewer)
        for index in range(100):  # without yielding to the server: only the last can be sent
            hub.write(capture(index), make_step(stamp_ns=index * MS))
        return await next_image(viewer)

    assert pumped(hub, act)["time_ms"] == 99.0


def test_a_viewer_that_does_not_acknowledge_delays_no_other(hub):
    async def act():
        slow, eager = Viewer("slow"), Viewer("eager")
        hub.join(slow)
        hub.join(eager)
        seen = []
        for index in range(20):
            hub.write(capture(index), make_step(stamp_ns=index * MS))
            header = await next_image(eager)
            eager.acknowledge(header["number"])
            seen.append(header["time_ms"])
            if slow.is_ready:
                await next_image(slow)
        return seen, slow.is_ready

    seen, is_ready = pumped(hub, act)
    assert seen == [float(index) for index in range(20)]
    assert not is_ready


def test_images_in_flight_are_limited():
    async def act():
        viewer = Viewer("page 1")
        for number in range(1, MAX_IN_FLIGHT + 1):
            assert viewer.is_ready
            viewer.put_image(number, b"image")
            assert await viewer.next() == b"image"
        assert not viewer.is_ready
        viewer.acknowledge(1)
        assert viewer.is_ready
        viewer.wants_images = False
        assert not viewer.is_ready

    run_in_thread(act())


def test_nothing_is_encoded_without_viewers(hub, monkeypatch):
    from haptigraph.dashboard.server import hub as module

    encoded = []
    monkeypatch.setattr(module, "encode_jpeg", lambda *_: encoded.append(1) or b"")

    async def act():
        for index in range(10):
            hub.write(capture(index), make_step(stamp_ns=index * MS))
            await asyncio.sleep(0)
        viewer = Viewer("page 1")
        hub.join(viewer)
        hub.write(capture(10), make_step(stamp_ns=10 * MS))
        await next_image(viewer)

    pumped(hub, act)
    assert len(encoded) == 1


def test_haptic_edges_are_published_in_order_from_another_thread(hub):
    async def act():
        viewer = Viewer("page 1")
        hub.join(viewer)
        edges = [(index * MS, index % 2 * 0.5, 80.0) for index in range(200)]
        thread = threading.Thread(target=lambda: [hub.record_level(*edge) for edge in edges])
        thread.start()
        received = []
        while len(received) < len(edges):
            received += (await next_text(viewer, "haptics"))["edges"]
        thread.join()
        return received

    assert pumped(hub, act) == [[float(index), index % 2 * 0.5, 80.0] for index in range(200)]


@pytest.mark.parametrize("is_blind", [False, True])
def test_a_late_viewer_gets_the_level_in_force_unless_blinded(hub, is_blind):
    async def act():
        first, late = Viewer("page 1"), Viewer("page 2", is_blind=is_blind)
        hub.join(first)
        hub.record_level(5 * MS, 0.0, 0.0)
        hub.record_level(9 * MS, 0.3, 80.0)
        await next_text(first, "haptics")
        hub.join(late)
        hub.publish("passing")
        received = []
        while not received or received[-1]["type"] != "passing":
            received.append(json.loads(await late.next()))
        return [message["edges"] for message in received if message["type"] == "haptics"]

    assert pumped(hub, act) == ([] if is_blind else [[[9.0, 0.3, 80.0]]])


def test_a_step_without_image_is_sent(hub):
    async def act():
        viewer = Viewer("page 1")
        hub.join(viewer)
        hub.write(Capture(3, 5 * MS, None), make_step(LOW, stamp_ns=5 * MS, state="unknown"))
        return await next_image(viewer)

    header = pumped(hub, act)
    assert header["has_picture"] is False
    assert header["state"] == "unknown"


def test_late_viewers_get_retained_messages_only(hub):
    async def act():
        hub.publish("passing", number=1)
        hub.publish("controls", retain=True, holder="page 1")
        hub.publish("controls", retain=True, holder="page 2")
        viewer = Viewer("page 3")
        hub.join(viewer)
        return [json.loads(await viewer.next()) for _ in range(2)]

    assert run_in_thread(act()) == [{"type": "hello"}, {"type": "controls", "holder": "page 2"}]


def test_steps_after_the_server_has_stopped_are_ignored(hub):
    async def act():
        hub.join(Viewer("page 1"))

    pumped(hub, act)
    hub.write(capture(), make_step())
    hub.record_level(0, 1.0, 80.0)
    hub.close()


def test_a_phase_is_entered_by_the_holder_of_the_controls_or_by_anyone_without_a_holder(hub):
    first, second = Viewer("page 1"), Viewer("page 2")
    phased = PhasedSource(TeleopSource("align_then_approach", VirtualClock()), ("approach", "injection"))
    named = []

    async def act():
        controls = Controls(hub, Teleop(30.0), phased)
        for viewer, phase in ((first, "injection"), (second, "lunch")):
            controls.enter_phase(viewer, phase)
            named.append(phased.named)
        controls.take(first)
        for viewer in (second, first):
            controls.enter_phase(viewer, "approach")
            named.append(phased.named)

    run_in_thread(act())
    assert named == ["injection", "injection", "injection", "approach"]


def test_controls_belong_to_one_viewer_until_it_releases_them(hub):
    teleop = Teleop(30.0)

    async def act():
        controls = Controls(hub, teleop)
        first, second = Viewer("page 1"), Viewer("page 2")
        controls.take(first)
        controls.take(second)
        controls.tune(second, {"motion_scale": 1.0})
        assert teleop.settings.motion_scale == 0.2
        controls.tune(first, {"tremor_filter": True})
        controls.tune(first, {"motion_scale": 0.5})
        assert teleop.settings == TeleopSettings(motion_scale=0.5, tremor_filter=True)
        controls.release(second)
        controls.take(second)
        controls.tune(second, {"motion_scale": 1.0})
        assert teleop.settings.motion_scale == 0.5
        controls.release(first)
        controls.take(second)
        controls.tune(second, {"motion_scale": 1.0})
        assert teleop.settings.motion_scale == 1.0

    run_in_thread(act())


def test_releasing_the_controls_disengages(hub):
    moved = []

    class Steered(Teleop):
        def put(self, motion):
            moved.append(motion)

    async def act():
        controls, viewer = Controls(hub, Steered(30.0)), Viewer("page 1")
        controls.move(viewer, HandMotion(True, 1.0))  # ignored: does not hold the controls
        controls.take(viewer)
        controls.move(viewer, HandMotion(True, 2.0))
        controls.release(viewer)

    run_in_thread(act())
    assert moved == [HandMotion(True, 2.0), HandMotion(False)]


def test_without_teleoperation_nobody_holds_the_controls(hub):
    async def act():
        controls, viewer = Controls(hub, None), Viewer("page 1")
        hub.join(viewer)
        controls.take(viewer)
        return [await viewer.next(), await viewer.next()]

    assert json.loads(run_in_thread(act())[1]) == {"type": "controls", "holder": ""}
