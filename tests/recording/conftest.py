from pathlib import Path

import pytest

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.recording import writer as writer_module


def record(uri: str, path: Path, *settings: str) -> None:
    config = load_config(
        None,
        (f"source.uri={uri}", "run.realtime=false", f'recording.path="{path}"', *settings),
    )
    assemble.build(config).run()


@pytest.fixture(scope="session")
def recording_file(quick_uri, tmp_path_factory) -> Path:
    """A complete recording of the quick scenario. Read-only."""
    path = tmp_path_factory.mktemp("recording") / "quick.mcap"
    record(quick_uri, path, "trial.participant=P07", "trial.trial=3")
    return path


@pytest.fixture(scope="session")
def journal_file(quick_uri, tmp_path_factory) -> Path:
    """The same recording before compaction. Read-only."""
    path = tmp_path_factory.mktemp("journal") / "quick.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer_module, "compact", lambda path, progress, identity, **options: 0)
        record(quick_uri, path)
    return path
