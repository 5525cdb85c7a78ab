import sys
from importlib import resources

import msgspec
import numpy as np
import pytest
from paths import DATA

from haptigraph.errors import BadInput, MissingExtra, RenamedKey
from haptigraph.perception.oct.onnx_model import SHIPPED, ModelFile, OnnxModel
from haptigraph.toml_document import Document

pytest.importorskip("onnxruntime", reason="needs ONNX Runtime", exc_type=ImportError)
onnx_files = pytest.importorskip("onnx_files", reason="needs onnx", exc_type=ImportError)


LEVELS = [0.1, 0.9, 0.4, 0.65]  # vitreous, needle, retina, RPE
GREY = [round(255 * level) for level in LEVELS]


def steps(sharpness=400.0, channels=1):
    return onnx_files.grey_steps_net(LEVELS, sharpness, channels)


def refusal(folder, model=None, text="", **values):
    path = onnx_files.write_model(folder, model or steps(), text, **values)
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


def test_images_are_resized_and_converted_to_the_networks_input(tmp_path):
    model = OnnxModel(str(onnx_files.write_model(tmp_path, steps())))
    colour = np.full((300, 500, 3), GREY[2], np.uint8)
    assert (model(colour).argmax(axis=0) == 2).all()


def test_grey_is_normalized_as_the_toml_specifies(tmp_path):
    path = onnx_files.write_model(tmp_path, steps(), mean=100.0, sd=50.0)
    assert (OnnxModel(str(path))(np.full((48, 64), 120, np.uint8)).argmax(axis=0) == 2).all()


def test_the_same_image_gives_the_same_numbers(tmp_path):
    path = str(onnx_files.write_model(tmp_path, steps(40.0)))
    image = np.random.default_rng(1).integers(0, 256, (48, 64)).astype(np.uint8)
    assert np.array_equal(OnnxModel(path)(image), OnnxModel(path)(image))


def test_the_shipped_model_runs():
    model = OnnxModel()
    maps = model(np.random.default_rng(1).integers(0, 256, (512, 512)).astype(np.uint8))
    assert maps.shape == (5, 256, 256)


# --- networks and TOML files that do not match


def test_a_network_with_another_number_of_classes_is_refused(tmp_path):
    message = refusal(tmp_path, classes=5)
    assert (
        "net.toml, line 3: the network returns 1 x 4 x 48 x 64; expected one map for each of the 5 classes"
        in message
    )


def test_a_class_index_out_of_range_is_refused(tmp_path):
    text = onnx_files.TOML.format(**onnx_files.DEFAULTS).replace("between = [2, 3]", "between = [2, 7]")
    assert "entity.rpe: expected a class from 0 to 3, found 7" in refusal(tmp_path, text=text)


def test_a_network_with_another_input_shape_is_refused(tmp_path):
    model = onnx_files.network(np.zeros((4, 1, 1, 1), np.float32), np.zeros(4, np.float32), [1, 1, 32, 32])
    message = refusal(tmp_path, model)
    assert (
        "takes tensor(float) of 1 x 1 x 32 x 32, but [input] specifies tensor(float) of 1 x 1 x 48 x 64"
        in message
    )
    flat = onnx_files.network(np.zeros((4, 1, 1), np.float32), np.zeros(4, np.float32), ["n", 1, "w"])
    assert "takes tensor(float) of n x 1 x w" in refusal(tmp_path, flat)


def test_logits_declared_as_probabilities_are_refused(tmp_path):
    assert 'set values = "logits"' in refusal(tmp_path, values="probabilities")


def test_a_missing_or_damaged_network_is_refused(tmp_path):
    path = onnx_files.write_model(tmp_path, steps())
    (tmp_path / "net.onnx").write_bytes(b"not a network")
    with pytest.raises(BadInput, match=r"net.onnx: not a network that ONNX Runtime can run"):
        OnnxModel(str(path))
    (tmp_path / "net.onnx").unlink()
    with pytest.raises(BadInput, match=r"line 2: no such file: .*; put the network beside its TOML file"):
        OnnxModel(str(path))
    with pytest.raises(BadInput, match=r"gone.toml: cannot be read"):
        OnnxModel(str(tmp_path / "gone.toml"))
    with pytest.raises(BadInput, match="this is the network; give the TOML file"):
        OnnxModel(str(tmp_path / "net.onnx"))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("format = 1", "format = 2", "format 2 is not supported"),
        ("between = [0, 2]", "", "expected either between"),
        ("between = [0, 2]", "between = [0, 2]\nline = 3", "expected either between"),
        ("[entity.needle]\nclass = 1", "", ""),
        ("sd_grey = 255.0", "sd_grey = 0.0", "sd_grey"),
        ("width_px = 64", "", "'width_px' is missing"),
        ("[entity.ilm]", "[entity.ILM]", "unknown key 'ILM'; valid: ilm, needle, rpe"),
    ],
)
def test_an_invalid_toml_file_is_refused(tmp_path, old, new, message):
    text = onnx_files.TOML.format(**onnx_files.DEFAULTS).replace(old, new)
    path = onnx_files.write_model(tmp_path, steps(), text)
    if not message:  # the needle class is optional
        assert OnnxModel(str(path)).spec.entity.needle is None
        return
    with pytest.raises(BadInput, match=message):
        OnnxModel(str(path))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (None, "line 21: no such file: .*profile.onnx; put the network beside its TOML file"),
        (7, "profile.onnx fails on profiles of 210 values"),
        (210, ""),
    ],
)
def test_an_unsuitable_second_network_is_refused(tmp_path, values, message):
    text = (
        onnx_files.TOML.format(**onnx_files.DEFAULTS) + 'upper_edge = true\nconfirmed_by = "profile.onnx"\n'
    )
    path = onnx_files.write_model(tmp_path, steps(), text)
    if values is not None:
        net = onnx_files.profile_net(np.ones(values) / values, 1.0)
        (tmp_path / "profile.onnx").write_bytes(net.SerializeToString())
    if message:
        with pytest.raises(BadInput, match=message):
            OnnxModel(str(path))
        return
    too_deep = OnnxModel(str(path)).too_deep(np.array([[-1.0] * 210, [200.0] * 210], np.float32))
    assert too_deep == pytest.approx([0.5, 1.0], abs=1e-4)


def test_a_second_network_that_returns_something_else_is_refused(tmp_path):
    text = onnx_files.TOML.format(**onnx_files.DEFAULTS) + 'upper_edge = true\nconfirmed_by = "net.onnx"\n'
    with pytest.raises(BadInput, match=r"net\.onnx fails on profiles of 210 values"):
        OnnxModel(str(onnx_files.write_model(tmp_path, steps(), text)))


def test_only_an_upper_edge_is_confirmed_by_profiles(tmp_path):
    text = onnx_files.TOML.format(**onnx_files.DEFAULTS) + 'confirmed_by = "profile.onnx"\n'
    with pytest.raises(BadInput, match="confirmed_by needs upper_edge = true"):
        OnnxModel(str(onnx_files.write_model(tmp_path, steps(), text)))


def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingExtra, match=r"haptigraph\[onnx\]"):
        OnnxModel(str(onnx_files.write_model(tmp_path, steps())))


def test_a_toml_file_of_version_0_1_is_read_with_a_warning():
    old_file = DATA / "v0_1" / "network.toml"
    with pytest.warns(RenamedKey) as warned:
        old = Document.read(old_file).convert(ModelFile)
    (warning,) = warned
    assert str(warning.message) == f"{old_file}, line 13: key 'deviation_grey' is now called 'sd_grey'"
    shipped = Document.read(str(resources.files("haptigraph.models") / SHIPPED)).convert(ModelFile)
    needle = msgspec.structs.replace(shipped.entity.needle, least_confidence=None)
    rpe = msgspec.structs.replace(shipped.entity.rpe, upper_edge=False, confirmed_by="")
    entity = msgspec.structs.replace(shipped.entity, needle=needle, rpe=rpe)
    assert old == msgspec.structs.replace(shipped, entity=entity)
