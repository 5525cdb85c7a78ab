"""Shared fixtures. The eye of the tests is the simulator's; clips beside the checkout are used where present."""

import atexit
import gc
import os
import re
import shutil
import signal
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

# Before NumPy and OpenCV: their matrices and images here are small, so threads of every worker and program would only
# wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")

import pytest
import ros_network as ros_network_module
from hypothesis import settings
from paths import DATA, SHARED

from haptigraph.assemble import load_procedure
from haptigraph.inference.procedure import Procedure
from haptigraph.perception.needle.rectify import EyeGeometry
from haptigraph.projection import ImageGeometry
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text

# The same examples on every machine; `make fuzz` looks for new ones.
settings.register_profile("haptigraph", deadline=None, derandomize=True, max_examples=50)
settings.register_profile("fuzz", deadline=None, max_examples=3000)
settings.load_profile("haptigraph")

# Matplotlib's settings and list of fonts are those of this run, workers and programs included: a user's settings change
# figures, and a list that another environment wrote may lack the fonts of this one.
if "PYTEST_XDIST_WORKER" not in os.environ:
    os.environ["MPLCONFIGDIR"] = tempfile.mkdtemp(prefix="haptigraph-matplotlib-")
    atexit.register(shutil.rmtree, os.environ["MPLCONFIGDIR"], ignore_errors=True)

# A shell's background job ignores them, and so would the runs that tests start and end by them.
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

# No test may open a browser on the screen of whoever runs it.
for display in ("DISPLAY", "WAYLAND_DISPLAY"):
    os.environ.pop(display, None)

CLIPS = SHARED / "clips"
REAL_TIME = {"bridges", "cameras", "dashboard", "faults", "haptics", "interop", "ros2"}  # folders


def is_in_real_time(path: Path) -> bool:
    return bool(REAL_TIME.intersection(path.relative_to(Path(__file__).parent).parts))


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out the files of the other half of the tests, because every worker imports those that it collects."""
    half = config.option.markexpr
    if half.startswith("not realtime"):
        return is_in_real_time(collection_path) or None
    if not half.startswith("realtime") or collection_path.is_dir() or is_in_real_time(collection_path):
        return None
    return not re.search(rb"mark\.(realtime|browser)", collection_path.read_bytes()) or None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of pages, devices, networks and running programs."""
    for item in items:
        if is_in_real_time(item.path) or item.get_closest_marker("browser"):
            item.add_marker("realtime")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep modules and items of tests, which stay anyway, out of every garbage collection.

    With thousands of tests one takes a third of a second, and statsmodels starts one at each correction of p-values.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.enable()


@pytest.fixture(scope="session")
def chromium():
    """One browser for all tests; skipped without Chromium."""
    from live_bench import CHROMIUM
    from live_bench import chromium as start_chromium

    if CHROMIUM is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    with start_chromium() as browser:
        yield browser


@pytest.fixture(scope="session")
def quick() -> str:
    """The path of a short scenario in small pictures."""
    return str(DATA / "quick.toml")


@pytest.fixture(scope="session")
def quick_scan() -> str:
    """The path of a short scenario in small B-scans."""
    return str(DATA / "quick_scan.toml")


@pytest.fixture(scope="session")
def quick_volume() -> str:
    """The path of a short scenario in small volumes."""
    return str(DATA / "quick_volume.toml")


@pytest.fixture(scope="session")
def quick_uri(quick: str) -> str:
    return f"phantom:{quick}"


@pytest.fixture(scope="session")
def sparse_uri(quick: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The same motion in a third of the images, for tests that need a run, but not each of its steps."""
    from helpers import scenario_at

    return f"phantom:{scenario_at(5, quick, tmp_path_factory.mktemp('sparse'))}"


@pytest.fixture(scope="session")
def procedure() -> Procedure:
    return load_procedure("subretinal_injection")


@pytest.fixture(scope="session")
def registration_toml() -> str:
    geometry = ImageGeometry(center_px=(160.0, 120.0), mm_per_px=1 / 8, mirrored=True)
    return registration_text(Eye(EyeShape()), geometry, 320, 240)


@pytest.fixture(scope="session")
def registration(registration_toml: str) -> Registration:
    return parse_registration(registration_toml, "registration.toml")


@pytest.fixture(scope="session")
def find_anatomy():
    """Find the anatomy in equal images only once."""
    from helpers import remembered

    from haptigraph.analysis.registering import registering

    return remembered(registering.find_anatomy)


@pytest.fixture(scope="module")
def anatomy_once(find_anatomy) -> Iterator[None]:
    """Registrations of equal images, of which these tests make many, share what was found in them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("haptigraph.analysis.registering.registering.find_anatomy", find_anatomy)
        yield


@pytest.fixture
def eye(registration: Registration) -> EyeGeometry:
    return EyeGeometry(registration)


@pytest.fixture(params=["A_easy", "B_dark"])
def clip(request: pytest.FixtureRequest) -> Path:
    folder = CLIPS / request.param
    if not folder.is_dir():
        pytest.skip(f"{folder} is not here")
    return folder


@pytest.fixture(scope="session")
def ros_network() -> Iterator[None]:
    """DDS on this machine alone, here and in the processes that tests start."""
    pytest.importorskip("cyclonedds")
    with pytest.MonkeyPatch.context() as patch:
        for name, value in ros_network_module.loopback(ros_network_module.tag()).items():
            patch.setenv(name, value)
        yield


@pytest.fixture
def peer(ros_network: None) -> Iterator["ros_network_module.Peer"]:
    peer = ros_network_module.Peer()
    yield peer
    peer.node.close()


@pytest.fixture(scope="session")
def lsl_network(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Lab Streaming Layer on this machine alone, here and in the processes that tests start."""
    settings = tmp_path_factory.mktemp("lsl") / "lsl_api.cfg"
    session = ros_network_module.tag()
    settings.write_text(
        "[ports]\nIPv6 = disable\n[multicast]\nResolveScope = machine\n"
        f"[lab]\nKnownPeers = {{127.0.0.1}}\nSessionID = {session}\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LSLAPICFG", str(settings))
        pytest.importorskip("pylsl")
        yield
