"""A recording of a video contains the file itself, and each step says which of its images it used."""

import json
import random
import signal
import subprocess
import sys
from hashlib import sha256
from itertools import islice
from pathlib import Path

import av
import cv2
import fastjsonschema
import numpy as np
import pytest
from click.testing import CliRunner
from damages import DAMAGES, truncate
from helpers import make_step
from mcap.reader import make_reader
from mcap.records import Message
from paths import DATA

from haptigraph.analysis.metrics.replay import replay
from haptigraph.assemble import build, open_source
from haptigraph.clock import VirtualClock
from haptigraph.commands.recordings import recover as recover_command
from haptigraph.commands.recordings import replay as replay_command
from haptigraph.config import load_config
from haptigraph.dashboard.recordings.folder import RecordingFolder
from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.projection import ImageGeometry
from haptigraph.recording import attachments, compaction, stored_video
from haptigraph.recording import writer as writer_module
from haptigraph.recording.attachments import AttachedFile
from haptigraph.recording.codec import decode, format_of
from haptigraph.recording.journal import Journal, complete_records
from haptigraph.recording.reader import RunReader
from haptigraph.recording.recovery import recover
from haptigraph.recording.scan import scan
from haptigraph.recording.schema import TOPICS, RunInfo, mcap_schema
from haptigraph.recording.stored_video import StoredVideo, crc_of_pixels
from haptigraph.recording.writer import RunWriter
from haptigraph.sources.recording import RecordingSource
from haptigraph.sources.video import VideoSource

CLIP = DATA / "renderings" / "golden_thin" / "clip.mp4"
IMAGES = 39
SIZE_PX = 160, 120
GEOMETRY = ImageGeometry((10.0, 10.0), 0.1, mirrored=False)
SHA = {text: sha256(text.encode()).hexdigest() for text in "rp"}
INFO = RunInfo("0", "2026-01-01T00:00:00+00:00", 10**18, "test", 30.0, "{}", "r", SHA["r"], "p", SHA["p"])


def record(clip: Path, path: Path, *settings: str):
    registration = CLIP.with_name("registration.toml")
    names = (f'source.uri="{clip}"', f'source.registration="{registration}"', f'recording.path="{path}"')
    loop = build(load_config(None, (*names, "run.realtime=false", *settings)))
    return loop.run()


@pytest.fixture(scope="session")
def whole(tmp_path_factory) -> Path:
    """A complete recording of a clip. Read-only."""
    path = tmp_path_factory.mktemp("video") / "clip.mcap"
    record(CLIP, path)
    return path


@pytest.fixture(scope="session")
def journal(tmp_path_factory) -> Path:
    """The same recording before compaction. Read-only."""
    path = tmp_path_factory.mktemp("video") / "clip.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer_module, "compact", lambda *arguments, **options: 0)
        record(CLIP, path)
    return path


@pytest.fixture(params=["journal", "whole"])
def recording(request) -> Path:
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def images() -> list[np.ndarray]:
    """The images of the clip."""
    return images_of(CLIP)


def images_of(path: Path) -> list[np.ndarray]:
    source = VideoSource(path)
    try:
        return [source.read(1.0).image for _ in range(round(source._video.get(cv2.CAP_PROP_FRAME_COUNT)))]
    finally:
        source.close()


def write_video(path: Path, count: int, codec: str = "libx264", pixels: str = "yuv420p", **options) -> Path:
    """Write a video of noise that changes from image to image."""
    noise = np.random.default_rng(0)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30, options=options)
        stream.width, stream.height, stream.pix_fmt = *SIZE_PX, pixels
        for _ in range(count):
            image = noise.integers(0, 255, (SIZE_PX[1], SIZE_PX[0], 3), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    return path


def attached(path: Path) -> list[tuple[str, bytes]]:
    with path.open("rb") as file:
        return [
            (found.name, found.data) for found in make_reader(file, validate_crcs=True).iter_attachments()
        ]


def place_of_video(path: Path) -> AttachedFile:
    records = (record for _, record in complete_records(path))
    return next(record for record in records if isinstance(record, AttachedFile))


def test_a_recording_contains_the_file_once_instead_of_its_images(recording, whole):
    place = place_of_video(recording)
    assert recording.read_bytes()[place.start : place.start + place.size] == CLIP.read_bytes()
    assert attached(whole) == [("clip.mp4", CLIP.read_bytes())]
    assert whole.stat().st_size < 1.2 * CLIP.stat().st_size
    captures = list(RunReader(recording).records(images=()))
    assert len(captures) == IMAGES + 1  # and the end
    assert all(capture.encoded is None for capture, _ in captures)


def test_messages_say_which_image_they_are_of_and_satisfy_their_schema(whole, images):
    check = fastjsonschema.compile(
        mcap_schema(next(topic for topic in TOPICS if topic.name == "/capture"), ())
    )
    with whole.open("rb") as file:
        found = [json.loads(message.data) for *_, message in make_reader(file).iter_messages(["/capture"])]
    assert [check(capture) for capture in found] == found
    assert [capture["image"] for capture in found] == ["video"] * IMAGES + ["none"]
    expected = [{"number": number, "crc32": crc_of_pixels(image)} for number, image in enumerate(images)]
    assert [capture.get("video") for capture in found] == [*expected, None]


def test_replaying_decodes_the_images_of_the_run(recording, images):
    reader = RunReader(recording)
    for number, (capture, _) in enumerate(islice(reader.records(), IMAGES)):
        assert np.array_equal(capture.image, images[number])
    report = replay(recording)
    assert (report.identical, report.steps) == (IMAGES + 1, IMAGES + 1)
    assert (report.dropped_images, report.differing_images) == (0, 0)


def test_only_selected_images_are_decoded(whole, images):
    captures = [capture for capture, _ in RunReader(whole).records(images={2, 20})]
    assert [number for number, capture in enumerate(captures) if capture.image is not None] == [2, 20]
    assert np.array_equal(captures[20].image, images[20])


def test_images_are_found_in_any_order(recording, images, monkeypatch):
    monkeypatch.setattr(stored_video, "NEAR", 2)
    reader = RunReader(recording)
    places = [place for place, _ in reader.places()]
    for number in random.Random(0).choices(range(IMAGES), k=12):
        assert np.array_equal(reader.record_at(places[number])[0].image, images[number])
    assert reader.differing_images == 0
    assert reader.record_at(places[IMAGES])[0].image is None


class Misleading:
    """A video that seeks another image than the one requested."""

    def __init__(self, video):
        self._video = video

    def __getattr__(self, name):
        return getattr(self._video, name)

    def set(self, which, number):
        self._video.set(which, number - 1)


def test_an_image_that_opencv_does_not_find_is_counted_from_the_first(whole, images, monkeypatch):
    open_part = stored_video.open_part
    monkeypatch.setattr(stored_video, "open_part", lambda *part: Misleading(open_part(*part)))
    monkeypatch.setattr(stored_video, "NEAR", 2)
    video = StoredVideo(place_of_video(whole))
    for number in (20, 5, 6, 25):
        image, is_same = video.image(number, crc_of_pixels(images[number]))
        assert is_same
        assert np.array_equal(image, images[number])
    with pytest.raises(ValueError, match=f"clip.mp4 has no image {IMAGES} that OpenCV"):
        video.image(IMAGES, 0)
    assert video.image(0, crc_of_pixels(images[0]))[1]
    video.close()
    video.close()


class Brighter(Misleading):
    """A decoder that rounds differently."""

    def read(self):
        has_image, image = self._video.read()
        return has_image, None if image is None else np.where(image < 255, image + 1, image)


def test_a_decoder_that_gives_other_pixels_is_reported(whole, monkeypatch):
    open_part = stored_video.open_part
    monkeypatch.setattr(stored_video, "open_part", lambda *part: Brighter(open_part(*part)))
    report = replay(whole)
    assert report.differing_images == IMAGES
    assert report.decoder == f"OpenCV {cv2.__version__}"
    source = RecordingSource(whole)
    first, second = source.read(1.0), source.read(1.0)
    source.close()
    (fault,) = first.faults
    assert fault.message == f"image has other pixels than when OpenCV {cv2.__version__} decoded it"
    assert second.faults == first.faults


def test_the_commands_say_what_is_lost_and_end_with_an_error(whole, tmp_path, monkeypatch):
    path, place = tmp_path / "run.mcap", place_of_video(whole)
    data = bytearray(whole.read_bytes())
    data[place.start + 1000] ^= 1
    path.write_bytes(data)
    runner = CliRunner()
    result = runner.invoke(recover_command, [str(path)])
    assert result.exit_code == 1
    assert f"missing: {IMAGES} images, because their video was damaged" in result.output
    result = runner.invoke(replay_command, [str(tmp_path / "run.recovered.mcap")])
    assert result.exit_code == 1
    assert f"{IMAGES} images were not recorded; steps that depend on them differ" in result.output
    open_part = stored_video.open_part
    monkeypatch.setattr(stored_video, "open_part", lambda *part: Brighter(open_part(*part)))
    result = runner.invoke(replay_command, [str(whole)])
    assert f"{IMAGES} images have other pixels here, decoded by OpenCV" in result.output
    assert result.exit_code == 1


def test_the_page_shows_images_of_the_video(whole, images):
    folder = RecordingFolder(whole.parent)
    folder.open_run(whole.name, [place for place, _ in RunReader(whole).places()])
    for number in (30, 2):
        message = folder.step(whole.name, number)
        picture = message[4 + int.from_bytes(message[:4], "big") :]
        assert np.array_equal(decode(picture), images[number])


def test_an_interrupted_recording_is_completed_with_its_video(journal, whole, tmp_path):
    path, data = tmp_path / "torn.mcap", journal.read_bytes()
    path.write_bytes(data[: -len(data) // 40])
    steps = RunReader(path).count()[0]
    assert 0 < steps < IMAGES
    recovery = recover(path)
    assert (recovery.saved, recovery.is_lossless, recovery.steps) == (path, True, steps)
    assert attached(path) == attached(whole)
    assert replay(path).identical == steps


CHILD = """
import sys
from haptigraph.assemble import build
from haptigraph.config import load_config
settings = (f'source.uri="{sys.argv[1]}/clip.mp4"', f'source.registration="{sys.argv[1]}/registration.toml"')
config = load_config(None, (*settings, "run.realtime=true", f'recording.path="{sys.argv[2]}"'))
for step in build(config).steps():
    print(step.stamp_ns, flush=True)
"""


@pytest.mark.realtime
def test_kill_9_loses_at_most_one_second_of_a_video(tmp_path, images):
    path = tmp_path / "killed.mcap"
    with subprocess.Popen(
        [sys.executable, "-c", CHILD, str(CLIP.parent), str(path)], stdout=subprocess.PIPE, text=True
    ) as child:
        stamps = [int(line) for line in islice(child.stdout, IMAGES - 1)]
        child.send_signal(signal.SIGKILL)
        stamps += [int(line) for line in child.stdout if line.endswith("\n")]
    reader = RunReader(path)
    assert not reader.is_whole
    read_back = [(step.stamp_ns, capture) for capture, step in reader.records()]
    assert [stamp_ns for stamp_ns, _ in read_back] == stamps[: len(read_back)]
    assert stamps[-1] - read_back[-1][0] <= 1e9
    for _, capture in read_back[:IMAGES]:
        assert capture.image is None or np.array_equal(capture.image, images[capture.index])
    assert recover(path).is_lossless


def test_a_run_that_was_killed_while_the_video_was_stored_has_no_step(journal, tmp_path):
    path, place = tmp_path / "torn.mcap", place_of_video(journal)
    data = journal.read_bytes()[: place.start + place.size // 2]
    path.write_bytes(data)
    assert RunReader(path).count() == (0, 0)
    with pytest.raises(BadInput, match=r"no complete step \(byte \d+: an incomplete attached video\)"):
        recover(path)
    assert path.read_bytes() == data


def test_a_flipped_bit_in_the_video_costs_its_images_and_is_reported(recording, tmp_path):
    path, place = tmp_path / "run.mcap", place_of_video(recording)
    data = bytearray(recording.read_bytes())
    data[place.start + place.size // 2] ^= 1
    path.write_bytes(data)
    for use in (replay, lambda path: RunReader(path).count(), lambda path: list(RunReader(path).places())):
        with pytest.raises(BadInput, match=r"byte \d+: damaged \(crc of the attached clip.mp4 differs\)"):
            use(path)
    recovery = recover(path)
    assert path.read_bytes() == data
    assert (recovery.is_lossless, recovery.steps, recovery.missing) == (False, IMAGES + 1, [])
    assert recovery.lost_images == IMAGES
    assert recovery.left_out_bytes > place.size
    saved = RunReader(recovery.saved)
    assert saved.losses.images == str(IMAGES)
    assert saved.count() == (IMAGES + 1, IMAGES)
    assert [step for _, step in saved.records()] == [step for _, step in RunReader(recording).records()]
    again = recover(recovery.saved)
    assert (again.saved, again.is_lossless, again.lost_images) == (None, False, IMAGES)


def test_all_steps_before_a_cut_are_recovered(whole, tmp_path, monkeypatch):
    monkeypatch.setattr(compaction, "CHUNK_BYTES", 2**15)
    source, path, saved = (tmp_path / name for name in ("source.mcap", "cut.mcap", "cut.recovered.mcap"))
    compaction.write_compacted(source, (record for _, record in complete_records(whole)))
    data, pieces, place = source.read_bytes(), list(scan(source)), place_of_video(source)
    chunks = [piece for piece in pieces if piece.has_crc]
    video = next(piece for piece in pieces if place in piece.records)
    truth = [step for _, step in RunReader(whole).places()]
    ends = {
        each.sequence: piece.end for piece in chunks for each in piece.records if isinstance(each, Message)
    }
    assert len(chunks) > 3
    for cut in (
        *(piece.end + more for piece in chunks for more in (-1, 0)),
        *(video.start + 1, place.start + place.size // 2, video.end, len(data) - 20),
    ):
        path.write_bytes(data[:cut])
        saved.unlink(missing_ok=True)
        steps = sum(end <= cut for end in ends.values())
        if not steps:
            with pytest.raises(BadInput, match="contains no complete step"):
                recover(path)
            continue
        recovery = recover(path)
        found = [step for _, step in RunReader(recovery.saved).places()]
        assert found == truth[:steps]
        assert recovery.lost_images == (0 if cut >= video.end else min(len(found), IMAGES))


@pytest.mark.parametrize("at", [1, 9, 17, 29, -2])
def test_damage_around_the_video_is_noticed(recording, tmp_path, at):
    path, place = tmp_path / "run.mcap", place_of_video(recording)
    start = next(piece.start for piece in scan(recording) if place in piece.records)
    data = bytearray(recording.read_bytes())
    data[start + at if at > 0 else place.start + place.size - at] ^= 4
    path.write_bytes(data)
    with pytest.raises(BadInput, match=f"byte {start}: damaged"):
        RunReader(path).count()
    recovery = recover(path)
    assert [damage.start for damage in recovery.lost] == [start]
    assert (recovery.steps, recovery.lost_images) == (IMAGES + 1, IMAGES)


def test_damage_before_the_video_does_not_cost_it(recording, tmp_path):
    path, place = tmp_path / "run.mcap", place_of_video(recording)
    *_, before = [piece for piece in scan(recording) if piece.end < place.start]
    data = bytearray(recording.read_bytes())
    data[before.start + 1] ^= 1
    path.write_bytes(data)
    recovery = recover(path)
    assert (recovery.steps, recovery.lost_images) == (IMAGES + 1, 0)
    assert place_of_video(recovery.saved).size == CLIP.stat().st_size


def test_a_video_that_is_cut_out_is_missed(journal, tmp_path):
    path, data, place = tmp_path / "run.mcap", journal.read_bytes(), place_of_video(journal)
    (piece,) = [piece for piece in scan(journal) if place in piece.records]
    path.write_bytes(data[: piece.start] + data[piece.end :])
    with pytest.raises(BadInput, match=r"damaged \(the video of its images is missing\)"):
        list(RunReader(path).records())
    recovery = recover(path)
    assert (recovery.steps, recovery.lost_images, recovery.is_lossless) == (IMAGES + 1, IMAGES, False)


def test_a_video_changed_during_compaction_is_not_copied(journal, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(journal.read_bytes())
    place = place_of_video(path)
    data = bytearray(path.read_bytes())
    data[place.start + 7] ^= 1
    path.write_bytes(data)
    with (
        (tmp_path / "copy.mcap").open("wb") as output,
        pytest.raises(BadInput, match="crc of the attached file differs"),
    ):
        writer = attachments.AttachingWriter(output)
        writer.start()
        writer.copy_attachment(output, place)


def test_a_video_is_stored_in_blocks(tmp_path, monkeypatch):
    monkeypatch.setattr(attachments, "BLOCK", 1000)
    sizes = []
    write = Journal.write
    monkeypatch.setattr(Journal, "write", lambda file, data: sizes.append(len(data)) or write(file, data))
    writer = RunWriter(tmp_path / "run.mcap", INFO, GEOMETRY, (), CLIP)
    assert sizes[1] < 1000
    assert sizes[2:-2] == [1000] * (CLIP.stat().st_size // 1000)
    writer.discard()
    assert list(tmp_path.iterdir()) == []


def formats(path: Path) -> list[str]:
    captures = (capture for capture, _ in RunReader(path).records() if capture.image is not None)
    return [format_of(capture.encoded) if capture.encoded else "video" for capture in captures]


def test_the_images_of_another_file_are_stored_as_png(tmp_path, images):
    clip = tmp_path / "clip.mp4"
    clip.write_bytes((DATA / "renderings" / "black_round" / "clip.mp4").read_bytes())
    writer = RunWriter(tmp_path / "run.mcap", INFO, GEOMETRY, (), clip)
    other = images_of(clip)
    seen = [other[0], other[1], *images[2:5]]  # the file was replaced while it was read
    for number, image in enumerate(seen):
        writer.write(Capture(number, number, image), make_step(stamp_ns=number))
    (problem,) = writer.take_problems()
    assert problem == (
        "image 2 of clip.mp4, as stored in the recording, has other pixels; from here on, each image is stored "
        "as PNG"
    )
    assert writer.take_problems() == ()
    writer.close()
    assert formats(tmp_path / "run.mcap") == ["video"] * 2 + ["png"] * 3
    for number, (capture, _) in enumerate(RunReader(tmp_path / "run.mcap").records()):
        assert np.array_equal(capture.image, seen[number])


def vanish(clip: Path) -> None:
    clip.unlink()


def shrink(clip: Path) -> None:
    clip.write_bytes(clip.read_bytes()[:100_000])


def grow(clip: Path) -> None:
    with clip.open("ab") as file:
        file.write(b"more")


@pytest.mark.parametrize("change", [vanish, shrink, grow])
def test_a_file_that_is_changed_while_it_is_stored_leaves_no_trace(tmp_path, monkeypatch, images, change):
    clip, path = tmp_path / "clip.mp4", tmp_path / "run.mcap"
    clip.write_bytes(CLIP.read_bytes())
    write_attachment = writer_module.write_attachment

    def changed(*arguments):
        change(clip)
        return write_attachment(*arguments)

    monkeypatch.setattr(writer_module, "write_attachment", changed)
    writer = RunWriter(path, INFO, GEOMETRY, (), clip)
    (problem,) = writer.take_problems()
    assert problem.startswith(f"{clip} is not stored in the recording, but each image as PNG: ")
    writer.write(Capture(0, 0, images[0]), make_step())
    writer.close()
    assert formats(path) == ["png"]
    assert attached(path) == []
    assert recover(path).saved is None


def test_a_disk_that_is_too_full_for_the_video_gets_the_images_as_long_as_they_fit(
    tmp_path, monkeypatch, images
):
    write = Journal.write

    def full(file, data):
        if file.tell() + len(data) > 300_000:
            raise OSError(28, "No space left on device")
        return write(file, data)

    monkeypatch.setattr(Journal, "write", full)
    writer = RunWriter(tmp_path / "run.mcap", INFO, GEOMETRY, (), CLIP)
    (problem,) = writer.take_problems()
    assert problem.endswith("each image as PNG: No space left on device")
    monkeypatch.undo()
    writer.write(Capture(0, 0, images[0]), make_step())
    writer.close()
    assert formats(tmp_path / "run.mcap") == ["png"]


@pytest.mark.parametrize("setting", ["recording.store_video=false", "source.crop_px=[0, 0, 320, 240]"])
def test_images_are_stored_as_png_if_asked_for_or_if_they_are_cropped(tmp_path, setting, registration_toml):
    path, registration = tmp_path / "run.mcap", tmp_path / "registration.toml"
    registration.write_text(registration_toml)
    settings = (setting, f'source.registration="{registration}"') if "crop" in setting else (setting,)
    report = record(CLIP, path, *settings)
    assert report.faults == {}
    assert formats(path) == ["png"] * IMAGES
    assert (attached(path), RunReader(path).info.decoder) == ([], "")


def test_a_video_that_takes_more_space_than_its_images_is_not_stored(tmp_path):
    clip = write_video(tmp_path / "raw.avi", 5, "rawvideo", "bgr24")
    writer = RunWriter(tmp_path / "run.mcap", INFO, GEOMETRY, (), clip)
    for number, image in enumerate(images_of(clip)):
        writer.write(Capture(number, number, image), make_step(stamp_ns=number))
    assert writer.take_problems() == ()
    writer.close()
    assert formats(tmp_path / "run.mcap") == ["png"] * 5


def test_a_few_images_of_a_long_video_are_stored_alone(tmp_path):
    clip, path = write_video(tmp_path / "long.mp4", 60), tmp_path / "run.mcap"
    writer = RunWriter(path, INFO, GEOMETRY, (), clip)
    images = images_of(clip)
    for number in range(3):
        writer.write(Capture(number, number, images[number]), make_step(stamp_ns=number))
    assert path.stat().st_size > clip.stat().st_size
    writer.close()
    assert formats(path) == ["png"] * 3
    assert attached(path) == []
    for number, (capture, _) in enumerate(RunReader(path).records()):
        assert np.array_equal(capture.image, images[number])
    assert recover(path).saved is None


def test_images_that_the_recorder_dropped_are_passed_over(tmp_path, images):
    path = tmp_path / "run.mcap"
    writer = RunWriter(path, INFO, GEOMETRY, (), CLIP)
    for number in range(IMAGES):
        dropped = number % 3 == 1
        capture = Capture(number, number, None if dropped else images[number])
        writer.write(capture, make_step(stamp_ns=number), dropped=dropped)
    writer.close()
    reader = RunReader(path)
    assert reader.count() == (IMAGES, 13)
    for number, (capture, _) in enumerate(reader.records()):
        assert (capture.image is None) == (number % 3 == 1)
        assert capture.image is None or np.array_equal(capture.image, images[number])


def test_every_kind_of_container_is_stored_and_read_back(tmp_path):
    for name, codec, options in (
        ("b.mp4", "libx264", {"bf": "2", "g": "30"}),
        ("a.mkv", "ffv1", {}),
        ("a.webm", "libvpx-vp9", {}),
        ("a.ts", "libx264", {}),
    ):
        clip = write_video(tmp_path / name, 12, codec, "bgr0" if codec == "ffv1" else "yuv420p", **options)
        path = clip.with_suffix(".mcap")
        source = open_source(load_config(None, (f'source.uri="{clip}"',)), VirtualClock())
        writer = RunWriter(path, INFO, GEOMETRY, (), clip)
        images = []
        for _ in range(12):
            capture = source.read(1.0)
            images.append(capture.image)
            writer.write(capture, make_step(stamp_ns=capture.stamp_ns))
        source.close()
        assert writer.take_problems() == ()
        writer.close()
        read = [capture.image for capture, _ in RunReader(path).records()]
        assert all(np.array_equal(*pair) for pair in zip(read, images, strict=True))
        path.unlink()


@pytest.fixture(scope="session")
def small(tmp_path_factory) -> Path:
    """A folder with a journal and a complete recording of a small video. Read-only."""
    folder = tmp_path_factory.mktemp("small")
    clip = write_video(folder / "clip.mp4", 12, crf="45")
    writer = RunWriter(folder / "whole.mcap", INFO, GEOMETRY, (), clip)
    for number, image in enumerate(images_of(clip)):
        writer.write(Capture(number, number, image), make_step(stamp_ns=number))
    (folder / "journal.mcap").write_bytes((folder / "whole.mcap").read_bytes())
    writer.close()
    assert formats(folder / "whole.mcap") == ["video"] * 12
    return folder


def content(path: Path) -> dict[int, tuple[bytes | None, object]]:
    reader = RunReader(path)
    places = [place.sequence for place, _ in reader.places()]
    records = ((capture.image, step) for capture, step in reader.records())
    found = {
        number: (None if image is None else image.tobytes(), step)
        for number, (image, step) in zip(places, records, strict=True)
    }
    assert reader.differing_images == 0
    return found


def check_damaged(path: Path, data: bytes, how: object, truth: dict) -> str:
    path.write_bytes(data)
    saved = path.with_suffix(".recovered.mcap")
    saved.unlink(missing_ok=True)
    try:
        read = content(path)
        assert read.items() <= truth.items()
        assert len(read) == len(truth) or not RunReader(path).is_whole
    except BadInput:
        pass
    try:
        recovery = recover(path)
    except BadInput:
        assert path.read_bytes() == data
        return "refused"
    left = content(recovery.saved or path)
    if recovery.is_lossless:
        assert left.items() <= truth.items()
        assert len(left) == len(truth) or how is truncate or any(d.kind == "torn" for d in recovery.damage)
        return "complete"
    assert path.read_bytes() == data
    assert all(step == truth[number][1] for number, (_, step) in left.items())
    lost = [number for number, (image, _) in left.items() if image != truth[number][0]]
    assert len(lost) == recovery.lost_images
    assert {left[number][0] for number in lost} <= {None}
    return "saved"


def campaign(small: Path, tmp_path: Path, count: int, seed: int) -> dict[str, int]:
    rng, outcomes = random.Random(seed), {"complete": 0, "saved": 0, "refused": 0}
    truth = content(small / "whole.mcap")
    files = [(small / name).read_bytes() for name in ("journal.mcap", "whole.mcap")]
    for number in range(count):
        data, how = bytearray(files[number % 2]), rng.choice(DAMAGES)
        how(data, rng)
        outcomes[check_damaged(tmp_path / "damaged.mcap", bytes(data), how, truth)] += 1
    return outcomes


def test_no_random_damage_goes_unnoticed(small, tmp_path):
    outcomes = campaign(small, tmp_path, 40, 1)
    assert outcomes["saved"] > 16, outcomes


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_no_random_damage_goes_unnoticed_in_2000_files(small, tmp_path):
    outcomes = campaign(small, tmp_path, 2000, 2)
    assert outcomes["saved"] > 800, outcomes
