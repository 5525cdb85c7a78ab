"""The routes of the registration page: valid and invalid requests, files that cannot be read or written."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest
from event_loop import run_in_thread
from live_bench import Live
from registering import eye_image, send, write_eye, write_noise

from haptigraph.clock import MonotonicClock
from haptigraph.dashboard.registration.service import FileExists, RegistrationService
from haptigraph.dashboard.server.controls import Controls
from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.site import Site
from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.registration.loading import load_registration


def open_at(live, source, **more):
    return send(live, "open", {"source": str(source), "mirrored": True, "diameter_mm": 24.0, **more})


def save_body(found, path):
    return {
        "number": found["number"],
        "draft": found["draft"],
        "path": str(path),
        "picture": False,
        "overwrite": True,
    }


@pytest.fixture(scope="module")
def eye(quick, tmp_path_factory):
    return write_eye(tmp_path_factory.mktemp("eye"), quick)


@pytest.fixture(scope="module")
def found(live, eye):
    status, answer = open_at(live, eye)
    assert status == 200
    return answer


def test_a_source_is_opened_checked_and_saved(live, found, eye, tmp_path):
    assert (found["width_px"], found["height_px"], found["is_found"]) == (480, 270, True)
    assert found["path"] == str(eye.parent / "registration.toml")
    status, png = send(live, f"picture/{found['number']}")
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert status == 200 and (picture == cv2.imread(str(eye))).all()
    status, checked = send(live, "check", {"number": found["number"], "draft": found["draft"]})
    assert status == 200 and checked["problem"] == "" and len(checked["outline_px"]) == 120
    out = tmp_path / "eye.toml"
    body = {**save_body(found, out), "overwrite": False}
    assert send(live, "save", body) == (200, {"paths": [str(out)], "exists": ""})
    assert load_registration(out).width_px == 480
    assert [file.name for file in tmp_path.iterdir()] == ["eye.toml"]
    assert send(live, "load", {"number": found["number"], "path": str(out)})[1]["draft"]["file"] == "eye.toml"


def test_start_returns_the_source_that_runs(live, calm_uri):
    assert send(live, "start") == (200, {"source": calm_uri, "starts_loop": False})


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("gone.mp4", "gone.mp4: file not found; "),
        ("camera:7", "camera:7 cannot be opened; "),
        ("camera:x", "camera:x is no camera"),
        ("teleop", "teleop has no end; use phantom:SCENARIO"),
        ("phantom:none", "unknown scenario 'none'"),
    ],
)
def test_a_source_that_cannot_be_opened_is_refused(live, source, sentence):
    status, answer = open_at(live, source)
    assert status == 422
    assert sentence in answer["problem"] and "\n" not in answer["problem"]


def test_a_file_that_is_not_an_image_is_refused(live, tmp_path):
    (tmp_path / "no.png").write_text("no picture")
    assert (
        open_at(live, tmp_path / "no.png")[1]["problem"]
        == f"{tmp_path}/no.png: not an image that OpenCV can read"
    )


def test_a_source_without_an_eye_is_opened(live, tmp_path):
    status, answer = open_at(live, write_noise(tmp_path))
    assert status == 200 and not answer["is_found"]
    assert answer["note"].startswith("no eye in the picture")
    assert answer["draft"]["radius_px"] > 60


@pytest.mark.parametrize(
    ("path", "content"),
    [
        ("open", b""),
        ("open", b"[" * 100_000),
        ("open", b"\xff"),
        ("open", b"x" * 300_000),
        ("open", {"source": "", "mirrored": True, "diameter_mm": 24}),
        ("open", {"source": "a\0b", "mirrored": True, "diameter_mm": 24}),
        ("open", {"source": "x", "mirrored": True, "diameter_mm": 24, "more": 1}),
        ("check", {"number": 1}),
        ("check", b'{"number": 1, "draft": {"radius_px": 1e999}}'),
        ("save", {"number": 1, "draft": {}, "path": "x.toml", "picture": True, "overwrite": 1}),
        ("load", {"number": 1, "path": ""}),
    ],
)
def test_an_invalid_request_is_refused(live, path, content):
    status, answer = send(live, path, content)
    assert status == 400
    assert answer["problem"].startswith("invalid request: ") and "\n" not in answer["problem"]


def test_a_source_that_was_never_opened_is_refused(live, found):
    status, answer = send(live, "check", {"number": 999, "draft": found["draft"]})
    assert (status, answer["problem"]) == (422, "this source has been closed; open it again")
    assert send(live, "picture/999")[0] == 422


def test_requests_of_other_origins_are_refused(live, found):
    body = {"number": found["number"], "draft": found["draft"]}
    assert send(live, "check", body, Origin="http://evil.example")[0] == 403


def test_names_cannot_inject_toml(live, found):
    trocars = [{**found["draft"]["trocars"][0], "name": 'x"\nused = true\n#'}]
    assert (
        send(live, "check", {"number": found["number"], "draft": {**found["draft"], "trocars": trocars}})[0]
        == 400
    )


def test_positions_far_outside_the_image_are_refused(live, found):
    body = {"number": found["number"], "draft": {**found["draft"], "target_px": [5000, 5]}}
    status, answer = send(live, "check", body)
    assert (status, answer["problem"]) == (422, "(5000, 5) px lies far outside the 480 x 270 px image")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("eye.txt", "the name of a registration ends in .toml"),
        ("none/eye.toml", "its folder does not exist"),
        ("folder.toml", "is a folder; give the name of a file"),
    ],
)
def test_a_file_that_cannot_be_written_is_refused(live, found, tmp_path, name, sentence):
    (tmp_path / "folder.toml").mkdir()
    body = save_body(found, tmp_path / name)
    assert send(live, "save", body) == (422, {"problem": f"{tmp_path / name}: {sentence}"})
    assert [file.name for file in tmp_path.iterdir()] == ["folder.toml"]


def test_an_invalid_draft_is_not_written(live, found, tmp_path):
    draft = {**found["draft"], "target_px": found["draft"]["center_px"]}
    body = {**save_body(found, tmp_path / "eye.toml"), "draft": draft}
    status, answer = send(live, "save", body)
    assert status == 422 and "mm off the retina; at most 0.35 mm is plausible" in answer["problem"]
    assert list(tmp_path.iterdir()) == []


def test_registration_and_picture_are_written_together_or_not_at_all(live, found, eye, tmp_path):
    body = {**save_body(found, tmp_path / "made.toml"), "picture": True, "overwrite": False}
    (tmp_path / "made.png").write_text("precious")
    status, answer = send(live, "save", body)
    assert (status, answer) == (200, {"paths": [], "exists": f"{tmp_path}/made.png: already exists"})
    assert [file.name for file in tmp_path.iterdir()] == ["made.png"]
    assert send(live, "save", {**body, "overwrite": True})[0] == 200
    assert cv2.imread(str(tmp_path / "made.png")).shape == (270, 480, 3)
    status, answer = send(live, "save", {**save_body(found, eye.with_suffix(".toml")), "picture": True})
    assert status == 422 and answer["problem"].startswith(f"{eye}: is the source itself")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (None, "cannot be read"),
        (b"\xff", "not UTF-8"),
        (b"format = 1", "missing"),
        (b"[[[", "not valid TOML"),
    ],
)
def test_a_file_that_cannot_be_loaded_is_refused(live, found, tmp_path, content, sentence):
    file = tmp_path / "eye.toml"
    if content is not None:
        file.write_bytes(content)
    status, answer = send(live, "load", {"number": found["number"], "path": str(file)})
    assert status == 422 and str(file) in answer["problem"] and sentence in answer["problem"]


def test_a_file_is_overwritten_only_on_request(live, found, tmp_path):
    out = tmp_path / "eye.toml"
    out.write_text("precious")
    body = {**save_body(found, out), "overwrite": False}
    assert send(live, "save", body) == (200, {"paths": [], "exists": f"{out}: already exists"})
    assert out.read_text() == "precious"
    assert send(live, "save", {**body, "overwrite": True})[0] == 200
    load_registration(out)


def test_a_search_is_resumed_or_not_at_all(live, found, eye):
    assert open_at(live, eye, resume=True)[1]["number"] == found["number"]
    assert open_at(live, eye, resume=True, diameter_mm=23.0) == (200, {"cancelled": True})
    assert open_at(live, eye)[1]["number"] > found["number"]  # asked for anew, it is searched anew


def test_a_running_search_is_joined_and_cancelled_for_all_who_wait(live):
    source = {"source": "phantom:wrong_place_then_hit", "mirrored": True, "diameter_mm": 24.0}
    with ThreadPoolExecutor(2) as pool:
        first = pool.submit(send, live, "open", source)
        while not send(live, "progress")[1]["progress"]:
            pass
        second = pool.submit(send, live, "open", {**source, "resume": True})
        assert send(live, "cancel", {**source, "diameter_mm": 23.0}) == (200, {})
        assert not first.done() and not second.done()
        assert send(live, "cancel", source) == (200, {})
        assert first.result(30) == second.result(30) == (200, {"cancelled": True})
    assert send(live, "progress") == (200, {"progress": ""})


def service_for(source, *, is_local):
    hub = Hub(MonotonicClock())
    return hub, RegistrationService(Site(hub, Controls(hub, None), source, Path(), is_local))


def open_with(service, source):
    return run_in_thread(service.open(source, mirrored=True, diameter_mm=24.0))


def test_other_machines_have_access_to_the_working_folder_only(quick, tmp_path, monkeypatch):
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    for folder in (inside, outside):
        folder.mkdir()
        write_eye(folder, quick)
    (inside / "link").symlink_to(outside)
    monkeypatch.chdir(inside)
    _, service = service_for("phantom:align_then_approach", is_local=False)
    for source in (
        str(outside / "eye.png"),
        "../outside/eye.png",
        "link/eye.png",
        f"video:{outside}/eye.png",
        "camera:0",
        "~",
    ):
        with pytest.raises(BadInput, match=r"only files in haptigraph|no such source"):
            open_with(service, source)
    number = open_with(service, "eye.png")
    assert service.default_path("eye.png") == "registration.toml"
    draft = service.opened(number).draft
    for path in (str(outside / "eye.toml"), "../outside/eye.toml", "link/eye.toml"):
        with pytest.raises(BadInput, match="only files in haptigraph"):
            service.save(number, draft, path, picture=False, overwrite=True)
        with pytest.raises(BadInput, match="only files in haptigraph"):
            service.load(number, path)
    assert service.save(number, draft, "eye.toml", picture=False, overwrite=False) == ["eye.toml"]
    with pytest.raises(FileExists):
        service.save(number, draft, "eye.toml", picture=False, overwrite=False)
    assert [file.name for file in outside.iterdir()] == ["eye.png"]


def test_images_of_a_live_source_come_from_the_loop(quick, monkeypatch):
    monkeypatch.setattr("haptigraph.dashboard.registration.service.OBSERVE_S", 0.3)
    hub, service = service_for("camera:0", is_local=True)
    with pytest.raises(BadInput, match="camera:0: the loop currently receives no images from it"):
        open_with(service, "camera:0")
    hub.newest_capture = Capture(0, 0, eye_image(quick))
    opened = service.opened(open_with(service, "camera:0"))
    assert opened.anatomy is not None
    assert (opened.reference_image == eye_image(quick)).all()


def test_a_source_without_registration_serves_the_page(quick, tmp_path):
    write_eye(tmp_path, quick)
    with Live(tmp_path) as live:
        assert any("needs a registration; give --registration FILE" in line for line in live.lines)
        assert send(live, "start") == (200, {"source": str(tmp_path), "starts_loop": True})
        output = live.stop()
    assert "haptigraph: stopped" in output and "Traceback" not in output
    assert live.process.returncode == 0


def test_an_absent_camera_is_reported_on_the_page():
    with Live("camera:7") as live:
        status, answer = open_at(live, "camera:7")
        assert status == 422 and "camera:7 cannot be opened" in answer["problem"]
