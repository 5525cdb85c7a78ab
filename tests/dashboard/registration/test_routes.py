"""The registration page's routes as anyone meets them: nonsense, what cannot be read, what may not be written."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from event_loop import run_apart
from live_bench import Live
from registering import ask, eye_image, write_eye, write_grain

from haptigraph.clock import MonotonicClock
from haptigraph.dashboard.registration.service import ExistsAlready, RegistrationService
from haptigraph.dashboard.server.controls import Controls
from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.site import Site
from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.registration.loading import load_registration

pytestmark = pytest.mark.xdist_group("server")


def open_at(live, source, **more):
    return ask(live, "open", {"source": str(source), "mirrored": True, "diameter_mm": 24.0, **more})


def saving(found, path):
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
    status, png = ask(live, f"picture/{found['number']}")
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert status == 200 and (picture == cv2.imread(str(eye))).all()
    status, checked = ask(live, "check", {"number": found["number"], "draft": found["draft"]})
    assert status == 200 and checked["problem"] == "" and len(checked["outline_px"]) == 120
    out = tmp_path / "eye.toml"
    wish = {**saving(found, out), "overwrite": False}
    assert ask(live, "save", wish) == (200, {"paths": [str(out)]})
    assert load_registration(out).width_px == 480
    assert [file.name for file in tmp_path.iterdir()] == ["eye.toml"]
    assert ask(live, "load", {"number": found["number"], "path": str(out)})[1]["draft"]["file"] == "eye.toml"


def test_the_page_starts_from_what_runs(live, quick_uri):
    assert ask(live, "start") == (200, {"source": quick_uri, "starts": False})


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("gone.mp4", "gone.mp4: no such source; valid: "),
        ("camera:7", "camera:7 cannot be opened; "),
        ("camera:x", "camera:x is no camera"),
        ("teleop", "teleop has no end; give phantom:SCENARIO"),
        ("phantom:none", "unknown scenario 'none'"),
    ],
)
def test_what_cannot_be_opened_is_one_sentence(live, source, sentence):
    status, answer = open_at(live, source)
    assert status == 422
    assert sentence in answer["problem"] and "\n" not in answer["problem"]


def test_a_file_that_is_no_picture_is_one_sentence(live, tmp_path):
    (tmp_path / "no.png").write_text("no picture")
    assert (
        open_at(live, tmp_path / "no.png")[1]["problem"]
        == f"{tmp_path}/no.png: not an image that OpenCV can read"
    )


def test_that_register_refuses_is_no_error(live, tmp_path):
    status, answer = open_at(live, write_grain(tmp_path))
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
def test_nonsense_is_answered_with_one_sentence(live, path, content):
    status, answer = ask(live, path, content)
    assert status == 400
    assert answer["problem"].startswith("not understood: ") and "\n" not in answer["problem"]


def test_a_picture_that_was_never_opened_is_told(live, found):
    status, answer = ask(live, "check", {"number": 999, "draft": found["draft"]})
    assert (status, answer["problem"]) == (422, "this picture is not kept any more; open its source again")
    assert ask(live, "picture/999")[0] == 422


def test_other_pages_may_not_ask(live, found):
    wish = {"number": found["number"], "draft": found["draft"]}
    assert ask(live, "check", wish, Origin="http://evil.example")[0] == 403


def test_names_cannot_smuggle_toml(live, found):
    trocars = [{**found["draft"]["trocars"][0], "name": 'x"\nused = true\n#'}]
    assert (
        ask(live, "check", {"number": found["number"], "draft": {**found["draft"], "trocars": trocars}})[0]
        == 400
    )


def test_places_far_outside_are_refused(live, found):
    wish = {"number": found["number"], "draft": {**found["draft"], "target_px": [5000, 5]}}
    status, answer = ask(live, "check", wish)
    assert (status, answer["problem"]) == (422, "(5000, 5) px lies far outside the 480 x 270 px image")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("eye.txt", "the name of a registration ends in .toml"),
        ("none/eye.toml", "its folder does not exist"),
        ("folder.toml", "is a folder; the name of a file is needed"),
    ],
)
def test_what_cannot_be_written_is_one_sentence(live, found, tmp_path, name, sentence):
    (tmp_path / "folder.toml").mkdir()
    wish = saving(found, tmp_path / name)
    assert ask(live, "save", wish) == (422, {"problem": f"{tmp_path / name}: {sentence}"})
    assert [file.name for file in tmp_path.iterdir()] == ["folder.toml"]


def test_what_a_run_would_refuse_is_not_written(live, found, tmp_path):
    draft = {**found["draft"], "target_px": found["draft"]["center_px"]}
    wish = {**saving(found, tmp_path / "eye.toml"), "draft": draft}
    status, answer = ask(live, "save", wish)
    assert status == 422 and "mm off the retina; at most 0.35 mm is plausible" in answer["problem"]
    assert list(tmp_path.iterdir()) == []


def test_file_and_picture_are_written_both_or_neither(live, found, eye, tmp_path):
    wish = {**saving(found, tmp_path / "made.toml"), "picture": True, "overwrite": False}
    (tmp_path / "made.png").write_text("precious")
    status, answer = ask(live, "save", wish)
    assert (status, answer["problem"]) == (409, f"{tmp_path}/made.png: exists already")
    assert [file.name for file in tmp_path.iterdir()] == ["made.png"]
    assert ask(live, "save", {**wish, "overwrite": True})[0] == 200
    assert cv2.imread(str(tmp_path / "made.png")).shape == (270, 480, 3)
    status, answer = ask(live, "save", {**saving(found, eye.with_suffix(".toml")), "picture": True})
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
def test_what_cannot_be_loaded_is_one_sentence(live, found, tmp_path, content, sentence):
    file = tmp_path / "eye.toml"
    if content is not None:
        file.write_bytes(content)
    status, answer = ask(live, "load", {"number": found["number"], "path": str(file)})
    assert status == 422 and str(file) in answer["problem"] and sentence in answer["problem"]


def test_a_file_is_overwritten_only_on_request(live, found, tmp_path):
    out = tmp_path / "eye.toml"
    out.write_text("precious")
    wish = {**saving(found, out), "overwrite": False}
    assert ask(live, "save", wish) == (409, {"problem": f"{out}: exists already", "exists": True})
    assert out.read_text() == "precious"
    assert ask(live, "save", {**wish, "overwrite": True})[0] == 200
    load_registration(out)


def desk_for(source, *, is_local):
    hub = Hub(MonotonicClock())
    return hub, RegistrationService(Site(hub, Controls(hub, None), source, Path(), is_local))


def opened_by(service, source):
    return run_apart(service.open(source, mirrored=True, diameter_mm=24.0))


def test_other_machines_read_and_write_in_the_working_folder_only(quick, tmp_path, monkeypatch):
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    for folder in (inside, outside):
        folder.mkdir()
        write_eye(folder, quick)
    (inside / "way").symlink_to(outside)
    monkeypatch.chdir(inside)
    _, service = desk_for("phantom:align_then_approach", is_local=False)
    for source in (
        str(outside / "eye.png"),
        "../outside/eye.png",
        "way/eye.png",
        f"video:{outside}/eye.png",
        "camera:0",
        "~",
    ):
        with pytest.raises(BadInput, match=r"only files in the folder|no such source"):
            opened_by(service, source)
    number = opened_by(service, "eye.png")
    assert service.place("eye.png") == "registration.toml"
    draft = service.opened(number).draft
    for path in (str(outside / "eye.toml"), "../outside/eye.toml", "way/eye.toml"):
        with pytest.raises(BadInput, match="only files in the folder"):
            service.save(number, draft, path, picture=False, overwrite=True)
        with pytest.raises(BadInput, match="only files in the folder"):
            service.load(number, path)
    assert service.save(number, draft, "eye.toml", picture=False, overwrite=False) == ["eye.toml"]
    with pytest.raises(ExistsAlready):
        service.save(number, draft, "eye.toml", picture=False, overwrite=False)
    assert [file.name for file in outside.iterdir()] == ["eye.png"]


def test_what_is_live_is_taken_from_the_loop(quick, monkeypatch):
    monkeypatch.setattr("haptigraph.dashboard.registration.service.LOOK_S", 0.3)
    hub, service = desk_for("camera:0", is_local=True)
    with pytest.raises(BadInput, match="camera:0: the loop gets no images from it just now"):
        opened_by(service, "camera:0")
    hub.newest_capture = Capture(0, 0, eye_image(quick))
    opened = service.opened(opened_by(service, "camera:0"))
    assert opened.anatomy is not None
    assert (opened.still == eye_image(quick)).all()


def test_a_source_without_registration_leads_to_the_page(quick, tmp_path):
    write_eye(tmp_path, quick)
    with Live(tmp_path) as live:
        assert any("needs a registration; give --registration FILE" in line for line in live.told)
        assert ask(live, "start") == (200, {"source": str(tmp_path), "starts": True})
        said = live.stop()
    assert "haptigraph: stopped" in said and "Traceback" not in said
    assert live.process.returncode == 130


def test_a_camera_that_is_not_there_leads_to_the_page_which_says_so():
    with Live("camera:7") as live:
        status, answer = open_at(live, "camera:7")
        assert status == 422 and "camera:7 cannot be opened" in answer["problem"]
