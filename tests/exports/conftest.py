"""Environments with the libraries of other projects; `make test-exports` sets them up."""

import os
import subprocess

import pytest
from paths import ROOT

from haptigraph import assemble
from haptigraph.config import load_config

ENVIRONMENTS = ROOT / ".exports"
OFFLINE = {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1"}


@pytest.fixture(scope="session")
def read_in():
    """Run a script of this folder with the Python of another environment, without haptigraph; skip without it."""

    def run(name, script, *arguments):
        python = ENVIRONMENTS / name / "bin" / "python"
        if not python.exists():
            pytest.skip(f"{python} is missing; run `make test-exports`")
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | OFFLINE
        command = [str(part) for part in (python, ROOT / "tests" / "exports" / script, *arguments)]
        result = subprocess.run(command, env=environment, capture_output=True, text=True)
        assert result.returncode == 0, result.stderr

    return run


@pytest.fixture(scope="session")
def recordings(quick_uri, tmp_path_factory):
    """Two runs that differ; of the first, images were JPEG, of the second, PNG."""
    folder = tmp_path_factory.mktemp("recordings")
    paths = []
    for name, quality in (("jpeg", 90), ("png", 0)):
        paths.append(folder / f"{name}.mcap")
        settings = (
            f"source.uri={quick_uri}",
            "run.realtime=false",
            f"source.jpeg_quality={quality}",
            f'recording.path="{paths[-1]}"',
            "trial.participant=P01",
        )
        assemble.build(load_config(None, settings)).run()
    return paths
