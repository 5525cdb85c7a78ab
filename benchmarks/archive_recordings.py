"""Generate the recordings that `archive.py` measures: 2,000 runs of two seconds, 320 x 180, 20 damaged.

`python benchmarks/archive_recordings.py FOLDER`. A few runs are simulated for each procedure; each is then
written many times with another header (date, participant, trial), so that generation takes minutes. So many
files have equal images; every file is read and replayed for itself.
"""

import argparse
import datetime
import random
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.messages import Capture, Step
from haptigraph.recording.reader import RunReader
from haptigraph.recording.schema import RunInfo
from haptigraph.recording.writer import RunWriter
from haptigraph.registration.loading import parse_registration

PROCEDURES = (
    "subretinal_injection",
    "subretinal_injection_cautious",
    "subretinal_injection_continuous",
    "subretinal_injection_steady",
)
SCENARIO = """
[scenario]
description = "Two seconds in small images."
seed = {seed}

[camera]
width_px = 320
height_px = 180
center_px = [160.0, 99.0]
px_per_mm = 5.3
blur_px = 0.5

[appearance]
style = "{style}"

[[move]]
duration_s = 0.5
depth_mm = {depth_mm}
theta_deg = {theta_deg}

[[move]]
duration_s = 0.9
depth_mm = {reached_mm}
theta_deg = {reached_deg}

[[move]]
duration_s = 0.6
depth_mm = 22.8
theta_deg = 0.0
"""
FIRST = datetime.datetime(2026, 7, 1, 8, tzinfo=datetime.UTC)
BETWEEN_MIN = 61
PER_PROCEDURE = 6
DAMAGED = 20


def main() -> None:
    """Simulate, and write the recordings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="a new folder")
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    make_recordings(given.folder, given.count, given.seed)


def make_recordings(folder: Path, count: int, seed: int = 5) -> None:
    """Simulate some runs, write them as many recordings, and damage some of these."""
    folder.mkdir(parents=True)
    start_s = time.perf_counter()
    with tempfile.TemporaryDirectory() as place:
        runs = list(_simulated(Path(place), random.Random(seed)))
    simulated_s = time.perf_counter() - start_s
    paths = [write_recording(folder, number, *runs[number % len(runs)]) for number in range(count)]
    damage(paths, seed)
    size_mb = sum(path.stat().st_size for path in paths) / 1e6
    wall_s = time.perf_counter() - start_s
    print(f"{len(paths)} recordings, {size_mb:.0f} MB, of {len(runs)} simulated runs")
    print(f"{simulated_s:.0f} s to simulate, {wall_s:.0f} s in all")


def damage(paths: list[Path], seed: int) -> None:
    """Change bytes of some recordings: in the header, or in the middle."""
    for number, path in enumerate(random.Random(seed).sample(paths, min(DAMAGED, len(paths) // 3))):
        data = bytearray(path.read_bytes())
        at = 400 if number % 5 < 2 else len(data) // 2
        data[at : at + 40] = bytes(40)
        path.write_bytes(data)


def _simulated(place: Path, chance: random.Random) -> Iterator[tuple[RunInfo, list[tuple[Capture, Step]]]]:
    for procedure in PROCEDURES:
        for number in range(PER_PROCEDURE):
            text = SCENARIO.format(
                seed=chance.randrange(1000),
                style=chance.choice(["light", "dark"]),
                depth_mm=chance.uniform(2, 8),
                theta_deg=chance.uniform(-8, 8),
                reached_mm=chance.uniform(12, 23.3),
                reached_deg=chance.uniform(-6, 6),
            )
            scenario, recording = (place / f"{procedure}-{number}{suffix}" for suffix in (".toml", ".mcap"))
            scenario.write_text(text)
            settings = (
                f"source.uri=phantom:{scenario}",
                "run.realtime=false",
                f'recording.path="{recording}"',
            )
            assemble.build(load_config(None, (*settings, f"run.procedure={procedure}"))).run()
            reader = RunReader(recording)
            yield reader.info, list(reader.records())


def write_recording(folder: Path, number: int, info: RunInfo, records: list[tuple[Capture, Step]]) -> Path:
    """Write a run as a recording of another time, participant and trial."""
    started = FIRST + datetime.timedelta(minutes=BETWEEN_MIN * number)
    shift_ns = round((started - datetime.datetime.fromisoformat(info.started_utc)).total_seconds() * 1e9)
    participant = f"P{number // 40 + 1:02}"
    path = folder / participant / f"run-{number:04}.mcap"
    path.parent.mkdir(exist_ok=True)
    info = replace(
        info,
        started_utc=started.isoformat(),
        utc_offset_ns=info.utc_offset_ns + shift_ns,
        participant=participant,
        trial=f"trial-{number % 40 + 1}",
    )
    measures = assemble.parse_procedure(info.procedure, "procedure").schema.measure_names
    writer = RunWriter(path, info, parse_registration(info.registration, "registration").image, measures)
    for capture, step in records:
        writer.write(capture, step)
    writer.close()
    return path


if __name__ == "__main__":
    main()
