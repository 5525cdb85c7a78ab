import cv2
import numpy as np
import pytest

from haptigraph.assemble import build, load_procedure, perceiver_name
from haptigraph.config import Config, PerceptionConfig, load_config
from haptigraph.errors import BadInput
from haptigraph.messages import Capture
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.text import scan_registration_text
from haptigraph.sim.oct.scenes import random_scene

pytest.importorskip("onnxruntime", reason="needs ONNX Runtime", exc_type=ImportError)
onnx_files = pytest.importorskip("onnx_files", reason="needs onnx", exc_type=ImportError)

from haptigraph.perception.oct.segmentation import SegmentationPerceiver  # noqa: E402

LEVELS = [0.1, 0.9, 0.4, 0.65]  # vitreous, needle, retina, RPE
VITREOUS, METAL, RETINA, RPE = (round(255 * level) for level in LEVELS)
AXIAL_MM, LATERAL_MM = 0.004, 0.01


def registered(size_px, axial_mm=AXIAL_MM, lateral_mm=LATERAL_MM):
    return parse_registration(scan_registration_text(size_px, axial_mm, lateral_mm, "test"), "test")


@pytest.fixture
def perceive(tmp_path):
    """A perceiver whose network classifies by grey level, for images of 256 x 192 px."""
    net = onnx_files.grey_steps_net(LEVELS, 400.0)
    toml = onnx_files.write_model(tmp_path, net, width=256, height=192)
    return SegmentationPerceiver(registered((256, 192)), PerceptionConfig(model=str(toml)))


def drawn(*, needle=True, surfaces=True):
    image = np.full((192, 256), VITREOUS, np.uint8)
    if surfaces:
        image[120:160] = RETINA
        image[160:175] = RPE
    if needle:
        image[100:, :128] = VITREOUS  # its shadow
        cv2.line(image, (40, 0), (128, 110), METAL, 4)
    return Capture(0, 0, image)


def test_surfaces_and_needle_are_reported_in_millimetres(perceive):
    observation = perceive(drawn())
    middle_x, middle_y = 127.5, 95.5
    rows_mm = {name: [y for _, y in observation.found[name].points_mm] for name in ("ilm", "rpe")}
    assert np.median(rows_mm["ilm"]) == pytest.approx((middle_y - 119.5) * AXIAL_MM, abs=0.3 * AXIAL_MM)
    assert np.median(rows_mm["rpe"]) == pytest.approx((middle_y - 159.5) * AXIAL_MM, abs=0.3 * AXIAL_MM)
    tip_x, tip_y = observation.found["needle_tip"].at_mm
    assert tip_x == pytest.approx((128 - middle_x) * LATERAL_MM, abs=2 * LATERAL_MM)
    assert tip_y == pytest.approx((middle_y - 110) * AXIAL_MM, abs=3 * AXIAL_MM)
    line = observation.found["needle_line"]
    along = np.subtract(line.end_mm, line.start_mm)
    true = np.degrees(np.arctan2(-110 * AXIAL_MM, 88 * LATERAL_MM))
    assert np.degrees(np.arctan2(along[1], along[0])) == pytest.approx(true, abs=0.5)
    assert line.end_mm == observation.found["needle_tip"].at_mm
    assert 0.5 < observation.certainty.confidence <= 1


def test_absent_entities_are_not_reported(perceive):
    assert "needle_tip" not in perceive(drawn(needle=False)).found
    nothing = perceive(drawn(needle=False, surfaces=False))
    assert nothing.found == {}
    assert nothing.certainty is None


def test_interpolation_in_the_needles_shadow_is_marked(perceive):
    observation = perceive(drawn())
    left_mm = min(x for x, _ in observation.found["ilm"].points_mm)
    assert left_mm < (128 - 127.5) * LATERAL_MM  # extended below the tip
    assert observation.interpolated["ilm"]


def test_in_tissue_the_tip_is_at_the_shadows_edge_and_less_certain(perceive):
    capture = drawn()
    image = capture.image
    image[120:160] = RETINA
    image[160:175] = RPE
    for x in range(128):  # metal is visible down to the ILM only, but its line casts a shadow to x = 144
        image[max(120, round(1.25 * x)) :, x] = VITREOUS
    for x in range(128, 145):
        image[max(120, round(1.25 * x) - 40) :, x] = VITREOUS
    image[100:120, :100] = VITREOUS
    observation, above = perceive(capture), perceive(drawn())
    assert observation.found["needle_tip"].at_mm[0] == pytest.approx(
        (144.5 - 127.5) * LATERAL_MM, abs=2.5 * LATERAL_MM
    )
    assert observation.found["needle_tip"].at_mm[1] < (95.5 - 122) * AXIAL_MM  # below the ILM
    assert observation.certainty.tip_sd_mm > above.certainty.tip_sd_mm


def test_a_ghost_without_a_shadow_is_rejected(perceive):
    capture = drawn(needle=False)
    cv2.line(capture.image, (40, 0), (128, 110), METAL, 4)  # the tissue below it is visible
    assert "needle_tip" not in perceive(capture).found


def test_an_image_of_another_size_is_refused(perceive):
    with pytest.raises(BadInput, match="the registration is for 256 x 192 px"):
        perceive(Capture(0, 0, np.zeros((100, 100), np.uint8)))
    with pytest.raises(BadInput, match="a volume"):
        perceive(Capture(0, 0, np.zeros((4, 192, 256), np.uint8)))


def test_bscan_is_the_default_for_b_scan_procedures():
    assert perceiver_name(Config(), load_procedure("subretinal_injection_ioct")) == "bscan"


# --- the network that ships


def test_the_shipped_network_generalizes_to_new_b_scans():
    """A few B-scans, to notice a broken network; docs/segmentation_report.md has the full evaluation."""
    off_px = {"ilm": [], "rpe": []}
    angles_deg, tips_px = [], []
    for number in range(12):
        scene = random_scene(number, 301)
        scan, truth = scene.scan, (taken := scene.take()).truth
        registration = registered((512, 512), scan.axial_mm_per_px, scan.lateral_mm_per_px)
        found = SegmentationPerceiver(registration, PerceptionConfig())(Capture(0, 0, taken.image)).found
        for name, true_px, is_lit in (
            ("ilm", truth.ilm_px, truth.ilm_lit),
            ("rpe", truth.rpe_px, truth.rpe_lit),
        ):
            points = (
                [registration.image.to_px(point) for point in found[name].points_mm] if name in found else []
            )
            x, y = np.array(points).reshape(-1, 2).T
            lit = is_lit[np.clip(np.rint(x), 0, 511).astype(int)]
            off_px[name] += np.abs(y - np.interp(x, np.arange(512), true_px))[lit].tolist()
        if truth.needle is not None and "needle_tip" in found:
            start, end = (
                registration.image.to_px(point)
                for point in (found["needle_line"].start_mm, found["needle_line"].end_mm)
            )
            along = np.subtract(end, start)
            true = truth.needle.along_px
            angles_deg.append(np.degrees(np.arctan2(along[1], along[0]) - np.arctan2(true[1], true[0])))
            tips_px.append(np.hypot(*np.subtract(end, truth.needle.tip_px)))
    assert np.median(off_px["ilm"]) <= 1.5
    assert np.median(off_px["rpe"]) <= 1.5
    assert len(angles_deg) >= 8
    assert np.median(np.abs(angles_deg)) <= 0.5
    assert np.median(tips_px) <= 4


def test_a_segmentation_run_replays_identically(tmp_path):
    from haptigraph.analysis.metrics.replay import replay

    run = tmp_path / "run.mcap"
    for number in range(6):
        cv2.imwrite(str(tmp_path / f"{number}.png"), random_scene(2, 301).take(number=number).image)
    scan = random_scene(2, 301).scan
    settings = (
        f'source.uri="oct:{tmp_path}"',
        f"source.axial_mm_per_px={scan.axial_mm_per_px}",
        f"source.lateral_mm_per_px={scan.lateral_mm_per_px}",
        'run.procedure="subretinal_injection_ioct"',
        'perception.perceiver="segmentation"',
        f'recording.path="{run}"',
    )
    build(load_config(None, settings)).run()
    report = replay(run)
    assert report.identical == report.steps >= 6
