import numpy as np
import pytest

pytest.importorskip("onnxruntime", reason="needs ONNX Runtime", exc_type=ImportError)

from haptigraph.perception.oct.class_edges import PROFILE_VALUES
from haptigraph.perception.oct.onnx_model import OnnxModel
from training.profiles import KINDS, judge, scene_of


@pytest.mark.parametrize("kind", KINDS)
def test_the_rpe_of_every_kind_of_scan_is_compared_with_the_true_one(kind):
    one, same = (judge(OnnxModel(), scene_of(kind, 4)) for _ in range(2))
    assert np.array_equal(one.grey, same.grey)
    assert one.profiles().shape == (len(one.is_likely), PROFILE_VALUES)
    assert np.array_equal(one.profiles().any(axis=1), one.is_likely)
    assert one.is_learned.any()
    assert not one.is_deep[one.is_learned].all()


def test_an_rpe_in_the_needles_shadow_is_to_be_doubted():
    scene = scene_of("plain", 0)
    lit = scene.take().truth.rpe_lit[1::4]
    judged = judge(OnnxModel(), scene)
    assert judged.is_deep[~lit].mean() > 0.9
    assert judged.is_deep[lit].mean() < 0.5
