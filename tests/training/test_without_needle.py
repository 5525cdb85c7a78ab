import numpy as np
import pytest

pytest.importorskip("onnxruntime", reason="needs ONNX Runtime", exc_type=ImportError)

from haptigraph.perception.oct.onnx_model import OnnxModel
from training.without_needle import EmptyScan, empty_totals, score_empty


def scan(error_px, *, has_needle=False):
    return EmptyScan(0, True, has_needle, np.array(error_px, float), np.zeros(len(error_px)))


def test_only_errors_in_the_unsafe_direction_are_too_deep():
    assert scan([6, -20, 0, np.nan]).deep_share == pytest.approx(0.25)


def test_totals_count_needles_columns_and_the_worst_scan():
    scans = [scan([0.0] * 18 + [9, np.nan]), scan([1.0] * 20, has_needle=True)]
    totals = empty_totals(scans)
    assert (totals.scans, totals.needles, totals.scans_over) == (2, 1, 0)
    assert totals.deep_share == pytest.approx(1 / 40)
    assert totals.worst_share == pytest.approx(0.05)
    assert totals.found_share == pytest.approx(39 / 40)
    assert empty_totals([scan([9.0] * 2 + [0] * 18)]).scans_over == 1


def test_the_shipped_network_is_scored_reproducibly():
    one, other = (score_empty(OnnxModel(), 2, diseased=True, seed=7) for _ in range(2))
    assert [np.nansum(scan.rpe_error_px) for scan in one] == [np.nansum(scan.rpe_error_px) for scan in other]
