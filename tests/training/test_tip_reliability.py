"""Reliability: what became of tips of which a probability was said, on tips whose truth is drawn."""

import numpy as np
import pytest

from rendering.lot import LEARNED, UNSEEN
from training import tip_reliability
from training.tip_reliability import main, printed, reliability


def drawn(scenes: int, *, times: float = 1.0, seed: int = 1) -> dict[int, list[tuple[float, bool, float]]]:
    """Tips that are so many times as often far as is said of them."""
    rng = np.random.default_rng(seed)
    said = np.exp(rng.uniform(np.log(0.01), 0, (scenes, 200)))
    return {
        UNSEEN[number]: [(float(p), bool(rng.random() < times * p), abs(rng.normal())) for p in row]
        for number, row in enumerate(said)
    }


def test_what_is_true_lies_in_the_intervals():
    rows = reliability(drawn(40))
    assert [(row.low, row.high) for row in rows] == [
        (0.01, 0.03),
        (0.03, 0.1),
        (0.1, 0.3),
        (0.3, 0.6),
        (0.6, 1.0),
    ]
    assert sum(row.images for row in rows) == 40 * 200
    assert all(row.low <= row.predicted <= row.high for row in rows)
    assert all(row.interval[0] <= row.predicted <= row.interval[1] for row in rows)
    assert all(row.interval[0] <= row.far <= row.interval[1] for row in rows)


def test_who_is_too_sure_is_found_out():
    rows = reliability(drawn(40, times=3.0))[:3]
    assert all(row.predicted < row.interval[0] for row in rows)


def test_a_scene_that_is_always_wrong_widens_the_interval_and_is_named():
    honest = {number: [(0.01, False, 0.5)] * 50 for number in UNSEEN[:20]}
    (before,), (after,) = reliability(honest), reliability({**honest, UNSEEN[20]: [(0.01, True, 9.0)] * 50})
    assert before.far == 0 < before.interval[1]
    assert after.far == pytest.approx(1 / 21) and after.interval[0] == 0 and after.interval[1] > 0.1
    lines = printed({**honest, UNSEEN[20]: [(0.01, True, 9.0)] * 50})
    assert f"scene {UNSEEN[20]}" in lines[-1] and lines[-1].endswith("50 of 50 known tips are far")
    assert printed(honest)[-1].startswith("tip z")


def test_of_a_network_that_is_sure_of_nothing_no_tip_is_known():
    assert printed({UNSEEN[0]: [(0.5, False, 0.5)] * 50})[-1] == "none is known"


def test_one_scene_shows_nothing():
    (row,) = reliability({UNSEEN[0]: [(0.02, False, 0.5)] * 50})
    assert row.interval == (0.0, 1.0)


def test_no_scene_is_learned_and_unseen():
    assert not set(LEARNED) & set(UNSEEN)


def test_missing_pictures_are_one_sentence_that_says_how_to_make_them(monkeypatch, tmp_path):
    monkeypatch.setattr("rendering.tips.FOLDER", tmp_path)
    monkeypatch.setattr("sys.argv", ["tip_reliability"])
    with pytest.raises(
        SystemExit, match=r"^tip_reliability: 45 of 45 scenes are not rendered; make render-unseen$"
    ):
        main()


def test_the_report_and_its_figure_are_written(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(tip_reliability, "UNSEEN", UNSEEN[:2])
    monkeypatch.setattr(tip_reliability, "check_rendered", lambda *_: None)
    monkeypatch.setattr(tip_reliability, "ProcessPoolExecutor", InThisProcess)
    monkeypatch.setattr(tip_reliability, "judged_in", lambda number, weights: drawn(2)[number])
    monkeypatch.setattr("sys.argv", ["tip_reliability", "--figure", str(tmp_path / "it.png")])
    main()
    assert capsys.readouterr().out.splitlines() == printed(drawn(2))
    assert (tmp_path / "it.png").read_bytes().startswith(b"\x89PNG")


class InThisProcess:
    def __init__(self, *_):
        self.map = map

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass
