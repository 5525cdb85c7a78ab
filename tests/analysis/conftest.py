import shutil
from pathlib import Path

import pytest
from archive_recordings import write_recording

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.recording.reader import RunReader

COUNT = 4


@pytest.fixture(scope="session")
def short_run(quick_uri, tmp_path_factory):
    """Header and steps of a run."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    settings = (f"source.uri={quick_uri}", "run.realtime=false", f'recording.path="{path}"')
    assemble.build(load_config(None, settings)).run()
    reader = RunReader(path)
    return reader.info, list(reader.records())


@pytest.fixture(scope="session")
def recordings(short_run, tmp_path_factory) -> Path:
    """A read-only folder: four recordings of one run, of different length, and a damaged one."""
    info, records = short_run
    folder = tmp_path_factory.mktemp("recordings")
    for number in range(COUNT):
        write_recording(folder, number * 40, info, records[: 117 - 20 * number])
    damaged = folder / "damaged.mcap"
    data = bytearray((folder / "P01" / "run-0000.mcap").read_bytes())
    data[len(data) // 2 : len(data) // 2 + 40] = bytes(40)
    damaged.write_bytes(data)
    return folder


@pytest.fixture
def folder(recordings, tmp_path) -> Path:
    """A copy of these recordings."""
    return Path(shutil.copytree(recordings, tmp_path / "recordings"))


@pytest.fixture
def in_this_process(monkeypatch):
    """Spread work over no process, because starting one takes longer than the work."""

    def spread(work, tasks, **_):
        return ((task, work(task)) for task in tasks)

    for module in ("archive.index", "batch.batch"):
        monkeypatch.setattr(f"haptigraph.analysis.{module}.spread", spread)
