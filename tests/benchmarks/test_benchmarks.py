"""Every benchmark runs on minimal input and prints numbers, which are not checked here."""

import re
import subprocess
import sys

import pytest
from paths import ROOT

pytestmark = pytest.mark.slow  # they load all cores, which disturbs tests of timing

FOLDER = ROOT / "benchmarks"
START = """
import sys
_, folder, name, *arguments = sys.argv
sys.path.insert(0, folder)
benchmark = __import__(name)
sys.argv = [name, *arguments]
sys.modules["__main__"] = benchmark
for constant, value in {constants}.items():
    getattr(benchmark, constant)  # it must exist
    setattr(benchmark, constant, value)
benchmark.main()
"""
SMALLEST = {
    "archive": [
        (
            ("overhead", "index", "queries", "two", "dask", "--count", "4"),
            {"OVERHEAD_RECORDINGS": 1, "REPEATS": 1},
        )
    ],
    "bridges": [((), {"COUNT": 5, "STOPS": 1})],
    "bscan": [
        (("resample", "1"), {}),
        (("speed",), {"IMAGES": 3, "PASSES": 1}),
        (("speed", "--perceiver", "segmentation"), {"IMAGES": 3, "PASSES": 1}),
        (("sweep", "1"), {}),
    ],
    "bscan_approaches": [(("2", "--images", "1"), {})],
    "chatter": [((), {"IMAGES": 60, "APPROACHES": 2})],
    "device_profiles": [(("--persons", "2"), {})],
    "degraded": [((str(ROOT / "tests/data/renderings/golden_thin"),), {"MAX_IMAGES": 8})],
    "force": [(("2",), {"SABOTEUR_SESSIONS": 6, "PRESSES": 2})],
    "force_loop": [(("--seconds", "1"), {"SETTLE_S": 0.1, "CHROMIUM": None})],
    "inference": [(("subretinal_injection_ioct",), {"ROUNDS": 2})],
    "interval_coverage": [(("--repeats", "20", "--sizes", "6", "--print-only"), {})],
    "lens": [(("1", "1"), {})],
    "loop": [(("--steps", "20", "--paced", "5"), {"PASSES": 1})],
    "memory": [(("100",), {})],
    "depth": [(("--scenes", "2"), {})],
    "no_needle": [((), {"OF_A_KIND": 1, "IMAGES": 3})],
    "perception": [((), {"IMAGES": 40, "PASSES": 1})],
    "robot_approaches": [(("--approaches", "1", "--trials", "2"), {})],
    "rig_check": [(("--sound", "1", "--degraded", "1", "--sabotaged", "0", "--clips"), {})],
    "robot_place": [((), {"RUNS": 3})],
    "robot_loop": [(("--seconds", "1"), {"SETTLE_S": 0.1, "CHROMIUM": None})],
    "registration": [(("1", "3"), {})],
    "rig_registration": [((str(ROOT / "tests/data/rig_pictures"),), {})],
    "soak": [(("0.0006",), {"FILE_S": 2})],
    "sweep": [(("--participants", "2", "--block", "1"), {})],
    "touch": [(("1",), {})],
    "volume": [(("speed",), {"VOLUMES": 1, "PASSES": 1}), (("accuracy", "2"), {})],
    "volume_approaches": [(("2", "--images", "1"), {})],
    "touch_comparison": [(("--participants", "2", "--repetitions", "1", "--output", "{folder}"), {})],
}
"""By benchmark: its arguments, and the constants to reduce."""
IN_A_BROWSER = [
    (("load",), {"LOAD_S": 1, "ROUNDS": 1}),
    (("latency",), {"PRESSES": 2, "TURNS": 1}),
    (("memory", "40"), {}),
]


def run(name, arguments, constants, folder):
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", START.format(constants=constants), str(FOLDER), name]
        + [argument.format(folder=folder) for argument in arguments],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"\d", done.stdout), done.stderr


def test_every_benchmark_is_tested():
    assert {path.stem for path in FOLDER.glob("*.py")} == {
        *SMALLEST,
        "live",
        *(
            "archive_recordings",
            "bscan_lengths",
            "force_motions",
            "jitter",
            "rig_setups",
            "touch_trials",
            "volume_gap",
        ),  # parts of others
        *("ablation", "compare_commits", "r_comparison"),  # need minutes, a repository, R
    }


@pytest.mark.parametrize(
    ("name", "arguments", "constants"),
    [
        pytest.param(name, *case, id=" ".join((name, *case[0])))
        for name, cases in SMALLEST.items()
        for case in cases
    ],
)
def test_a_benchmark_runs(name, arguments, constants, tmp_path):
    run(name, arguments, constants, tmp_path)


@pytest.mark.browser
@pytest.mark.parametrize(("arguments", "constants"), IN_A_BROWSER, ids=("load", "latency", "memory"))
def test_a_benchmark_runs_in_a_browser(arguments, constants, tmp_path):
    run("live", arguments, constants, tmp_path)
