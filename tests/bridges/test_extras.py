"""Everything else works without the optional libraries, and a missing one is reported in one sentence."""

import json
import os
import subprocess
import sys

import pytest

LIBRARIES = (
    "av", "cyclonedds", "distributed", "duckdb", "foxglove", "matplotlib", "networkx", "onnxruntime", "pandas",
    "pyarrow", "pydicom", "pyigtl", "pylsl", "pyrealsense2", "rosbags", "scipy", "sdl2", "serial", "sounddevice",
    "sqlalchemy", "statsmodels", "xarray", "z3",
)  # fmt: skip
PROGRAM = """
import json, sys
from click.testing import CliRunner
from haptigraph.cli import main
results = [CliRunner().invoke(main, arguments) for arguments in json.load(sys.stdin)]
print(json.dumps([(result.exit_code, result.stdout, result.stderr) for result in results]))
"""
MISSING = {
    ("--bridge", "ros2"): ("ros2", "ros"),
    ("--bridge", "lsl"): ("bridge lsl", "lsl"),
    ("--bridge", "foxglove"): ("bridge foxglove", "foxglove"),
    ("--device", "audio"): ("device audio", "audio"),
    ("--device", "gamepad:0"): ("device gamepad", "gamepad"),
    ("--device", "ros2"): ("ros2", "ros"),
    ("--device", "serial:/dev/null"): ("device serial", "serial"),
}
SOURCES = {
    "ros2:/camera/image": ("ros2", "ros"),
    "realsense": ("a RealSense camera", "realsense"),
    "rosbag:bag.mcap": ("bag.mcap: a ROS bag", "rosbag"),
    "scan.dcm": ("scan.dcm: DICOM", "dicom"),
}


def run_bare(folder, program, stdin=""):
    """Run a program, and the processes that it starts, as if no extra were installed."""
    for name in LIBRARIES:
        (folder / f"{name}.py").write_text(f"raise ModuleNotFoundError({name!r})")
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-c", program], input=stdin, cwd=folder, env={**os.environ, "PYTHONPATH": path},
        capture_output=True, text=True, timeout=200,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def bare(tmp_path_factory, quick, quick_uri, registration_toml):
    """Exit code, output and errors of commands without extras."""
    folder = tmp_path_factory.mktemp("bare")
    (folder / "eye.toml").write_text(registration_toml)
    (folder / "scan.dcm").write_bytes(b"something")
    with open(quick) as file:
        (folder / "brief.toml").write_text("[[move]]".join(file.read().split("[[move]]")[:2]))
    commands = {
        **{key: ["run", quick_uri, "--record", "run.mcap", *key] for key in MISSING},
        **{uri: ["run", uri, "--registration", "eye.toml", "--record", "run.mcap"] for uri in SOURCES},
        "devices": ["devices"],
        "demo": ["demo", "--fast", "--scenario", "brief.toml", "--output", "demo"],
        "batch": ["batch", "replay", "demo", "-o", "batch", "--procedure", "subretinal_injection_steady"],
        "draw": ["touch", "draw", "subretinal_injection:success", "-o", "success.svg"],
        "trace": ["run", "phantom:brief.toml", "--fast", "--device", "trace:touch.csv"],
        "openigtlink": ["run", "phantom:brief.toml", "--bridge", "openigtlink:0"],
    }
    results = json.loads(run_bare(folder, PROGRAM, json.dumps([*commands.values()])))
    assert not (folder / "run.mcap").exists()
    return dict(zip(commands, results, strict=True))


@pytest.mark.parametrize("option", [*MISSING, *SOURCES], ids=str)
def test_a_missing_extra_is_one_sentence(bare, option):
    feature, extra = {**MISSING, **SOURCES}[option]
    sentence = f"haptigraph: {feature} needs an extra; install it with: pip install 'haptigraph[{extra}]'\n"
    assert bare[option] == [2, "", sentence]


def test_capabilities_of_devices_are_listed_without_extras(bare):
    code, listed, _ = bare["devices"]
    assert code == 0
    for extra in ("audio", "gamepad", "ros", "serial"):
        assert f"pip install 'haptigraph[{extra}]'" in listed
    assert "the joy node turns both motors alike" in listed


def test_the_demo_says_why_there_is_no_picture(bare):
    code, printed, errors = bare["demo"]
    assert code == 0, errors
    missing = "not drawn: a figure needs an extra; install it with: pip install 'haptigraph[figures]'"
    assert printed.endswith(f"picture         {missing}\n")
    assert "steps identical" in printed


def test_a_figure_names_its_extra(bare):
    sentence = "haptigraph: a figure needs an extra; install it with: pip install 'haptigraph[figures]'\n"
    assert bare["draw"] == [2, "", sentence]


def test_a_trace_has_no_plot_and_says_so(bare):
    code, _, errors = bare["trace"]
    assert code == 0, errors
    assert "touch.png, the plot of touch.csv, needs an extra" in errors
    assert "'haptigraph[figures]'" in errors


def test_the_phantom_runs_and_is_published_to_slicer_without_extras(bare):
    code, summary, errors = bare["openigtlink"]
    assert code == 0, errors
    assert "source ended" in summary


def test_a_run_without_bridges_imports_none_of_their_libraries(tmp_path, quick_uri):
    program = (
        "import sys; from haptigraph import build, load_config\n"
        f"build(load_config(settings=['source.uri={quick_uri}'])).close()\n"
        f"assert not set(sys.modules) & set({LIBRARIES!r})\n"
        "assert not [name for name in sys.modules if name.startswith(('haptigraph.bridges', 'haptigraph.ros2'))]"
    )
    run_bare(tmp_path, program)


def test_a_batch_needs_no_extra(bare):
    code, out, err = bare["batch"]
    assert code == 0, err
    assert "1 recording" in out
