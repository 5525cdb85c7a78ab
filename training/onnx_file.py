"""Write a PyTorch network as one ONNX file, including its weights."""

from pathlib import Path

import onnx
import torch
from torch import Tensor, nn

__all__ = ["write_onnx"]


def write_onnx(
    net: nn.Module, example: Tensor, names: tuple[str, str], file: Path, *, any_count: bool = False
) -> None:
    """Export a network; batch normalisation is folded into the layers before it.

    Args:
        net: The network.
        example: An input of the right shape.
        names: Of its input and of its output.
        file: Where to write it.
        any_count: Whether the first dimension of the input is free.
    """
    net.eval()
    shapes = ({0: torch.export.Dim("n", min=2)},) if any_count else None
    program = torch.onnx.export(
        net,
        (example,),
        dynamo=True,
        input_names=names[:1],
        output_names=names[1:],
        dynamic_shapes=shapes,
        verbose=False,
    )
    net.train()
    file.parent.mkdir(parents=True, exist_ok=True)
    program.save(str(file), external_data=False)
    file.write_bytes(_without_metadata(onnx.load(str(file))).SerializeToString())
    print(f"{file}: {file.stat().st_size / 1e6:.2f} MB", flush=True)


def _without_metadata(model: onnx.ModelProto) -> onnx.ModelProto:
    """Remove the exporter's metadata from a network, such as paths of source files on this machine."""
    parts = (model, model.graph, *model.graph.node, *model.graph.value_info)
    for part in (*parts, *model.graph.input, *model.graph.output, *model.graph.initializer):
        part.ClearField("doc_string")
        part.ClearField("metadata_props")
    return model
