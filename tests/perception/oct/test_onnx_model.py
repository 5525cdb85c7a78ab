import sys

import numpy as np
import pytest

from haptigraph.errors import BadInput, MissingExtra
from haptigraph.perception.oct.onnx_model import OnnxModel

pytest.importorskip("onnxruntime", reason="needs ONNX Runtime", exc_type=ImportError)
onnx_files = pytest.importorskip("onnx_files", reason="needs onnx", exc_type=ImportError)


LEVELS = [0.1, 0.9, 0.4, 0.65]  # vitreous, needle, retina, RPE
GREY = [round(255 * level) for level in LEVELS]


def steps(sharpness=400.0, channels=1):
    return onnx_files.grey_steps_net(LEVELS, sharpness, channels)


def refusal(folder, model=None, text="", **asked):
    path = onnx_files.write_model(folder, model or steps(), text, **asked)
    with pytest.raises(BadInput) as refused:
        OnnxModel(str(path))
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize("channels", [1, 3])
def test_classes_come_out_as_probabilities_at_the_size_of_the_input(tmp_path, channels):
    model = OnnxModel(str(onnx_files.write_model(tmp_path, steps(channels=channels))))
    image = np.repeat(np.array(GREY, np.uint8), 12)[:, None] * np.ones((1, 64), np.uint8)
    maps = model(image)
    assert maps.shape == (4, 48, 64)
    assert np.allclose(maps.sum(axis=0), 1, atol=1e-5)
    assert np.array_equal(maps.argmax(axis=0)[:, 0], np.repeat([0, 1, 2, 3], 12))


def test_other_sizes_and_colours_are_brought_to_what_the_network_takes(tmp_path):
    model = OnnxModel(str(onnx_files.write_model(tmp_path, steps())))
    colour = np.full((300, 500, 3), GREY[2], np.uint8)
    assert (model(colour).argmax(axis=0) == 2).all()


def test_grey_is_shifted_and_scaled_as_the_toml_says(tmp_path):
    path = onnx_files.write_model(tmp_path, steps(), mean=100.0, deviation=50.0)
    assert (OnnxModel(str(path))(np.full((48, 64), 120, np.uint8)).argmax(axis=0) == 2).all()


def test_the_same_image_gives_the_same_numbers(tmp_path):
    path = str(onnx_files.write_model(tmp_path, steps(40.0)))
    image = np.random.default_rng(1).integers(0, 256, (48, 64)).astype(np.uint8)
    assert np.array_equal(OnnxModel(path)(image), OnnxModel(path)(image))


def test_the_model_that_ships_is_small_and_runs():
    model = OnnxModel()
    maps = model(np.random.default_rng(1).integers(0, 256, (512, 512)).astype(np.uint8))
    assert maps.shape == (5, 256, 256)


# --- what does not fit is told


def test_a_network_with_other_classes_is_refused(tmp_path):
    said = refusal(tmp_path, classes=5)
    assert (
        "net.toml, line 3: the network returns 1 x 4 x 48 x 64; 1 x 5 x height x width was expected" in said
    )


def test_a_class_that_the_network_has_not_is_refused(tmp_path):
    text = onnx_files.TOML.format(**onnx_files.ASKED).replace("between = [2, 3]", "between = [2, 7]")
    assert "entity.rpe: class 7 of 4; 0 to 3 are valid" in refusal(tmp_path, text=text)


def test_a_network_of_another_shape_is_refused(tmp_path):
    model = onnx_files.network(np.zeros((4, 1, 1, 1), np.float32), np.zeros(4, np.float32), [1, 1, 32, 32])
    assert "takes tensor(float) of 1 x 1 x 32 x 32; tensor(float) of 1 x 1 x 48 x 64" in refusal(
        tmp_path, model
    )
    flat = onnx_files.network(np.zeros((4, 1, 1), np.float32), np.zeros(4, np.float32), ["n", 1, "w"])
    assert "takes tensor(float) of n x 1 x w" in refusal(tmp_path, flat)


def test_logits_are_not_taken_for_probabilities(tmp_path):
    assert 'values = "logits" if they are none' in refusal(tmp_path, values="probabilities")


def test_a_missing_or_torn_network_is_told(tmp_path):
    path = onnx_files.write_model(tmp_path, steps())
    (tmp_path / "net.onnx").write_bytes(b"not a network")
    with pytest.raises(BadInput, match=r"net.onnx: not a network that ONNX Runtime can run"):
        OnnxModel(str(path))
    (tmp_path / "net.onnx").unlink()
    with pytest.raises(BadInput, match=r"line 2: no such file: .*; the network lies beside its TOML"):
        OnnxModel(str(path))
    with pytest.raises(BadInput, match=r"gone.toml: cannot be read"):
        OnnxModel(str(tmp_path / "gone.toml"))
    with pytest.raises(BadInput, match="is the network; give the TOML beside it"):
        OnnxModel(str(tmp_path / "net.onnx"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("format = 1", "format = 2", "format 2 is not known"),
        ("between = [0, 2]", "", "either between"),
        ("between = [0, 2]", "between = [0, 2]\nline = 3", "either between"),
        ("[entity.needle]\nclass = 1", "", ""),
        ("sd_grey = 255.0", "sd_grey = 0.0", "sd_grey"),
        ("width_px = 64", "", "'width_px' is missing"),
        ("[entity.ilm]", "[entity.ILM]", "unknown key 'ILM'; valid: ilm, needle, rpe"),
    ],
)
def test_a_toml_that_makes_no_sense_is_refused(tmp_path, old, new, said):
    text = onnx_files.TOML.format(**onnx_files.ASKED).replace(old, new)
    path = onnx_files.write_model(tmp_path, steps(), text)
    if not said:  # a model need not know needles
        assert OnnxModel(str(path)).spec.entity.needle is None
        return
    with pytest.raises(BadInput, match=said):
        OnnxModel(str(path))


def test_without_the_extra_it_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingExtra, match=r"haptigraph\[onnx\]"):
        OnnxModel(str(onnx_files.write_model(tmp_path, steps())))
