import json
import re
from functools import partial

from helpers import call, refuse
from paths import GOLDEN, RENDERINGS

from haptigraph.assemble import load_procedure
from haptigraph.recording.reader import RunReader

RUN = GOLDEN / "wrong_place_then_hit.mcap"


def test_evaluate_prints_a_table_or_one_json_object():
    clip = RENDERINGS / "golden_thin"
    text = call("evaluate", clip, "--perceiver", "threshold", "--set", "perception.alpha=1").output
    assert "detection_rate" in text
    assert re.search(r"lag +-?0\.0\d images behind the truth \(alpha 1\)", text)
    scores = json.loads(call("evaluate", clip, "--json").output)
    recorded = json.loads(call("evaluate", clip, "--as-recorded", "--json").output)
    assert recorded != scores and recorded["final_state"] == scores["final_state"]
    unchanged = json.loads(
        call("evaluate", clip, "--as-recorded", "--set", "source.jpeg_quality=0", "--json").output
    )
    assert {**unchanged, "origin": scores["origin"]} == scores
    assert scores["origin"]["procedure_sha256"] == load_procedure("subretinal_injection").sha256
    assert scores["clip"] == clip.name
    assert set(scores["angle_error_deg"]) == {"shallow", "deep"}


def test_evaluate_scores_simulated_scenes(monkeypatch, tmp_path):
    from haptigraph.analysis.evaluation import accuracy

    small = {"size_px": (480, 270)}
    monkeypatch.setattr(accuracy, "sweep", partial(accuracy.sweep, **small))
    monkeypatch.setattr(accuracy, "angle_noise", partial(accuracy.angle_noise, depths_mm=(5.0,), **small))
    picture = tmp_path / "sweep.png"
    options = ("evaluate", "--simulated", 2, "--perceiver", "threshold", "--seed", 3)
    scores = json.loads(call(*options, "--json", "--figure", picture).output)
    assert scores["seed"] == 3
    assert scores["scenes"] == scores["perceivers"]["threshold"]["all"]["scenes"] == 2
    assert picture.stat().st_size > 10_000
    assert "Cramer-Rao" in call("evaluate", "--simulated", 1, "--perceiver", "threshold").output
    both = json.loads(call(*options, "--perceiver", "tracker", "--json").output)["perceivers"]
    assert list(both) == ["threshold", "tracker"] and both["threshold"] == scores["perceivers"]["threshold"]


def test_evaluate_takes_a_clip_or_simulated_scenes(tmp_path):
    for wrong in ((), (tmp_path, "--simulated", 3)):
        assert "either CLIP_DIR, RECORDING, --simulated N or --volumes FOLDER" in refuse("evaluate", *wrong)
    assert "--seed and --figure go with --simulated" in refuse("evaluate", tmp_path, "--seed", 1)
    twice = ("--perceiver", "threshold", "--perceiver", "tracker")
    assert "which goes with --simulated N; a clip takes one" in refuse("evaluate", tmp_path, *twice)
    assert "--as-recorded goes with CLIP_DIR" in refuse("evaluate", "--simulated", 1, "--as-recorded")
    assert "unknown perceiver 'none'" in refuse("evaluate", "--simulated", 1, "--perceiver", "none")
    configured = ("--set", "perception.perceiver=none")
    assert "unknown perceiver 'none'" in refuse("evaluate", "--simulated", 1, *configured)
    for wrong, problem in (("none/a.png", "no such folder"), ("a.xyz", "valid endings: .png, .svg, .pdf")):
        assert problem in refuse("evaluate", "--simulated", 1, "--figure", tmp_path / wrong)


def test_evaluate_scores_a_recording_of_a_simulated_eye():
    scores = json.loads(call("evaluate", RUN, "--json").output)
    assert scores["scored_images"] > 60 and scores["tips"] > 0.9 * scores["scored_images"]
    assert scores["tip_error_mm"]["median"] < 0.15 and scores["theta_error_deg"]["median"] < 1
    assert 0 < scores["tip_z"]["p68"] < scores["tip_z"]["p95"] < 4
    assert 0 < scores["theta_z"]["p68"] < scores["theta_z"]["p95"]
    assert scores["false_needles"] == 0
    largest = scores["largest_tip_errors_mm"]
    assert len(largest) == 3 and max(largest.values()) >= scores["tip_error_mm"]["p95"]
    assert all(re.fullmatch(r"at \d+\.\d\d s", time) for time in largest)
    assert scores["origin"]["procedure_sha256"] == RunReader(RUN).info.procedure_sha256
    assert re.search(r"^tip_error_mm\.median +0\.\d", call("evaluate", RUN).output, re.MULTILINE)
    assert "scored with its own settings" in refuse("evaluate", RUN, "--seed", 1)
    for name, problem in (("ioct_approach", "shows B-scans"), ("membrane_peeling", "reports no needle_tip")):
        assert problem in refuse("evaluate", GOLDEN / f"{name}.mcap")
