"""`haptigraph rig check`: exit codes, the report, and refusals."""

import json

import cv2
import pytest
from click.testing import CliRunner
from rig_setups import simulated_setup

from haptigraph.cli import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder of images with its registration."""
    made = tmp_path_factory.mktemp("rig")
    setup = simulated_setup(0, 9103, has_mark=True, has_reference=True)
    (made / "images").mkdir()
    for number, image in enumerate(setup.images[:8]):
        cv2.imwrite(str(made / "images" / f"{number}.png"), image)
    (made / "eye.toml").write_text(setup.registration.text)
    return made


def run(*arguments):
    return CliRunner().invoke(main, ["rig", "check", *map(str, arguments)])


def test_what_is_not_judged_does_not_pass_unless_accepted(folder):
    arguments = folder / "images", "--registration", folder / "eye.toml"
    refused, accepted = run(*arguments), run(*arguments, "--accept-unjudged")
    assert refused.exit_code == 1
    assert "not judged, frame rate" in refused.output
    assert "not judged, scale" in refused.output
    assert "FAILED" not in refused.output
    assert accepted.exit_code == 0, accepted.output


def test_a_finding_gives_exit_code_1_and_a_report(folder, tmp_path):
    for number in range(8):
        image = cv2.imread(str(folder / "images" / f"{number}.png"))
        cv2.imwrite(str(tmp_path / f"{number}.png"), image // 5)
    report = tmp_path / "report.json"
    result = run(tmp_path, "--registration", folder / "eye.toml", "--accept-unjudged", "--json", report)
    assert result.exit_code == 1
    assert "FAILED dim" in result.output
    content = json.loads(report.read_text())
    assert content["passed"] is False
    assert any(subject["findings"] for subject in content["subjects"])


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("absent.mp4",), "file not found"),
        (("phantom:align_then_approach", "--rig", "absent.toml"), "absent.toml"),
        (("phantom:ioct_approach",), "shows B-scans"),
    ],
)
def test_bad_input_gives_exit_code_2(arguments, problem):
    result = run(*arguments)
    assert result.exit_code == 2
    assert problem in result.output


def test_images_of_another_size_are_refused(folder, tmp_path):
    image = cv2.imread(str(folder / "images" / "0.png"))
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), image[:-20])
    result = run(tmp_path, "--registration", folder / "eye.toml")
    assert result.exit_code == 2
    assert "px" in result.output
