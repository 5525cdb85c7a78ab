import pytest

from haptigraph import assemble
from haptigraph.config import load_config


@pytest.fixture(scope="session")
def recording(quick_uri, tmp_path_factory):
    """A short run whose state and haptic output change."""
    path = tmp_path_factory.mktemp("exporting") / "run.mcap"
    settings = (
        f"source.uri={quick_uri}",
        "run.realtime=false",
        "trial.participant=P01",
        f'recording.path="{path}"',
    )
    assemble.build(load_config(None, settings)).run()
    return path
