from pathlib import Path

import pytest
from evidence_files import record


@pytest.fixture(scope="session")
def run(quick_uri: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run with contact."""
    return record(quick_uri, tmp_path_factory.mktemp("figures") / "run.mcap")


@pytest.fixture(scope="session")
def scan_run(quick_scan: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("figures") / "scan.mcap"
    return record(f"phantom:{quick_scan}", path, "subretinal_injection_ioct")
