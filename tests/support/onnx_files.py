"""Minimal hand-written networks for the perceiver `segmentation`."""

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

TOML = """format = 1
file = "net.onnx"
classes = {classes}
values = "{values}"

[input]
width_px = {width}
height_px = {height}
mean_grey = {mean}
sd_grey = {sd}

[entity.needle]
class = 1

[entity.ilm]
between = [0, 2]

[entity.rpe]
between = [2, 3]
"""
DEFAULTS = {"classes": 4, "values": "logits", "width": 64, "height": 48, "mean": 0.0, "sd": 255.0}


def grey_steps_net(levels: list[float], sharpness: float, channels: int = 1) -> onnx.ModelProto:
    """A network whose class is the level nearest to a pixel's grey value in [0, 1].

    -(g - l)^2 is linear in g except for a term that all classes share, so one 1 x 1 convolution suffices.
    """
    weights = np.zeros((len(levels), channels, 1, 1), np.float32)
    weights[:, 0, 0, 0] = [2 * sharpness * level for level in levels]
    bias = np.array([-sharpness * level**2 for level in levels], np.float32)
    return network(weights, bias, ["n", channels, "h", "w"])


def network(weights: np.ndarray, bias: np.ndarray, shape: list[object]) -> onnx.ModelProto:
    """One convolution."""
    graph = helper.make_graph(
        [helper.make_node("Conv", ["image", "weights", "bias"], ["logits"])],
        "net",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("logits", TensorProto.FLOAT, None)],
        [numpy_helper.from_array(weights, "weights"), numpy_helper.from_array(bias, "bias")],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)


def profile_net(weights: np.ndarray, bias: float, *, largest: bool = False) -> onnx.ModelProto:
    """A second network: the logit of an RPE that is too deep is linear in its profile of grey.

    With `largest`, every column gets the largest of all logits.
    """
    nodes = [helper.make_node("Gemm", ["profiles", "weights", "bias"], ["alone" if largest else "too_deep"])]
    if largest:
        nodes += [
            helper.make_node("ReduceMax", ["alone"], ["most"], axes=[0], keepdims=1),
            helper.make_node("Max", ["alone", "most"], ["too_deep"]),
        ]
    graph = helper.make_graph(
        nodes,
        "profile",
        [helper.make_tensor_value_info("profiles", TensorProto.FLOAT, ["n", len(weights)])],
        [helper.make_tensor_value_info("too_deep", TensorProto.FLOAT, ["n", 1])],
        [
            numpy_helper.from_array(np.asarray(weights, np.float32).reshape(-1, 1), "weights"),
            numpy_helper.from_array(np.array([bias], np.float32), "bias"),
        ],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)


def write_model(folder: Path, model: onnx.ModelProto, text: str = "", **fields: object) -> Path:
    """Write a network and its TOML file; return the path of the TOML file."""
    (folder / "net.onnx").write_bytes(model.SerializeToString())
    (folder / "net.toml").write_text(text or TOML.format(**{**DEFAULTS, **fields}))
    return folder / "net.toml"
