"""The tracker on six of the scenes that `make render` makes, kept here as it made them.

Bounds, not figures: docs/accuracy.md states what came out. Metal mirrors its surroundings here, as simulated
needles do not.
"""

from pathlib import Path

import pytest

from haptigraph.analysis.evaluation import evaluate_clip
from haptigraph.config import load_config

RENDERINGS = Path(__file__).parents[1] / "data" / "renderings"
MOST = {  # tip px p50, p95, angle p95 in degrees at 1 to 3 mm and beyond
    "black_round": (0.25, 0.8, 0.1, 0.15),
    "dark_bowl_bevel": (0.35, 2.8, 0.4, 0.2),
    "dark_bowl_long": (0.4, 0.95, 0.15, 0.15),
    "golden_thin": (0.45, 2.6, 0.1, 0.1),
    "orange_bowl": (2.3, 11.0, 0.35, 0.25),
    "second_instrument": (0.8, 3.6, 0.2, 0.3),
}


def test_every_rendering_has_its_bounds():
    assert {folder.name for folder in RENDERINGS.iterdir()} == set(MOST)


@pytest.mark.parametrize("name", MOST)
def test_a_rendered_needle_is_seen_where_it_is(name):
    scores = evaluate_clip(RENDERINGS / name, load_config()).scores
    tip_px, angle_deg = scores["tip_error_px"], scores["angle_error_deg"]
    assert scores["detection_rate"] == 1
    assert scores["false_detections"] == 0
    assert scores["wrong_contact_images"] == 0
    assert scores["state_agreement"] >= 0.96
    seen = tip_px["median"], tip_px["p95"], angle_deg["shallow"]["p95"], angle_deg["deep"]["p95"]
    assert all(one <= most for one, most in zip(seen, MOST[name], strict=True)), seen
