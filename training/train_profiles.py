"""Train the network that judges by the profile of grey whether an RPE is too deep.

`python -m training.train_profiles`. Everything is seeded. It learns from the errors of the U-Net, which is
trained before it.
"""

import argparse
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from haptigraph.perception.oct.class_edges import PROFILE_VALUES, PROFILE_WIDTHS_MM
from haptigraph.perception.oct.onnx_model import OnnxModel
from training.profiles import KINDS, Judged, judge, scene_of

__all__ = ["write_profile_net"]

TOML = Path(__file__).parent.parent / "haptigraph" / "models" / "bscan_unet.toml"
SEED = 8
HIDDEN, DROPOUT = (96, 24), (0.1, 0.2)
EPOCHS, BATCH, RATE, DECAY = 6, 1024, 3e-3, 1e-3
SAMPLES = PROFILE_VALUES // len(PROFILE_WIDTHS_MM)
BLURS = 1.0, 2.0, 3.0  # down a profile, standard deviation in samples; as many batches are not blurred
GAMMA_SD, GAIN_SD, OFFSET_SD = 0.25, 0.08, 0.03
PROCESSORS = 2


def write_profile_net(toml: Path) -> None:
    """Train it with the U-Net of a TOML file, and write it beside that."""
    torch.manual_seed(SEED)
    torch.set_num_threads(1)  # another number changes the order of sums
    torch.use_deterministic_algorithms(True)
    start_s = time.monotonic()
    wanted = [(toml, kind, number) for kind, count in KINDS.items() for number in range(count)]
    with ProcessPoolExecutor(PROCESSORS, get_context("spawn")) as pool:
        scans = list(pool.map(_judged, wanted, chunksize=20))
    print(f"{len(scans)} B-scans simulated in {time.monotonic() - start_s:.0f} s", flush=True)
    export(train(scans), toml.with_name("bscan_rpe.onnx"))


def _judged(which: tuple[Path, str, int]) -> Judged:
    toml, kind, number = which
    return judge(_model(toml), scene_of(kind, number))


@cache
def _model(toml: Path) -> OnnxModel:
    return OnnxModel(str(toml))


class ProfileNet(nn.Module):
    """Two hidden layers; its inputs are standardized by what it was trained on."""

    def __init__(self) -> None:
        super().__init__()
        first, second = HIDDEN
        self.norm = nn.BatchNorm1d(PROFILE_VALUES, affine=False)
        self.layers = nn.Sequential(
            nn.Dropout(DROPOUT[0]),
            nn.Linear(PROFILE_VALUES, first),
            nn.ReLU(),
            nn.Dropout(DROPOUT[1]),
            nn.Linear(first, second),
            nn.ReLU(),
            nn.Linear(second, 1),
        )

    def forward(self, profiles: torch.Tensor) -> torch.Tensor:
        """Return the logit of being too deep, (n, 1)."""
        return self.layers(self.norm(profiles))


def train(scans: list[Judged]) -> ProfileNet:
    """Train on all columns of all scans; the loss is not weighted, so that probabilities are calibrated."""
    inputs = torch.from_numpy(np.concatenate([scan.profiles() for scan in scans]))
    is_deep = np.concatenate([scan.is_deep[scan.is_likely] for scan in scans])
    target = torch.from_numpy(is_deep.astype(np.float32))[:, None]
    print(f"{len(target)} columns, in {target.mean():.1%} of which the RPE is too deep", flush=True)
    net = ProfileNet()
    steps = EPOCHS * (len(inputs) // BATCH)
    optimizer = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=steps, pct_start=0.1)
    loss_function = nn.BCEWithLogitsLoss()
    for epoch in range(EPOCHS):
        total = 0.0
        for chosen in _batches(len(inputs)):
            optimizer.zero_grad()
            loss = loss_function(net(varied(inputs[chosen].float())), target[chosen])
            loss.backward()
            optimizer.step()
            schedule.step()
            total += loss.item()
        print(f"epoch {epoch + 1}, loss {total / (len(inputs) // BATCH):.4f}", flush=True)
    return net.eval()


def varied(profiles: torch.Tensor) -> torch.Tensor:
    """Vary sharpness, brightness and contrast as between devices."""
    count = len(profiles)
    parts = profiles.view(count, -1, SAMPLES)
    chosen = int(torch.randint(0, 2 * len(BLURS), (1,)))
    if chosen < len(BLURS):
        at = torch.arange(float(SAMPLES))
        weights = torch.exp(-((at[:, None] - at) ** 2) / (2 * BLURS[chosen] ** 2))
        parts = parts @ (weights / weights.sum(dim=1, keepdim=True)).T
    if torch.rand(1).item() < 0.5:
        parts = torch.clamp(parts, min=0) ** torch.exp(GAMMA_SD * torch.randn(count, 1, 1))
    parts = parts * (1 + GAIN_SD * torch.randn(count, 1, 1)) + OFFSET_SD * torch.randn(count, 1, 1)
    return parts.reshape(count, -1)


def _batches(count: int) -> Iterator[torch.Tensor]:
    order = torch.randperm(count)
    for number in range(count // BATCH):
        yield order[number * BATCH : (number + 1) * BATCH]


def export(net: ProfileNet, file: Path) -> None:
    """Write the network, its standardization folded into the first layer."""
    linear = [layer for layer in net.layers if isinstance(layer, nn.Linear)]
    scale = 1 / torch.sqrt(net.norm.running_var + net.norm.eps)
    weights = [layer.weight.detach().double() for layer in linear]
    biases = [layer.bias.detach().double() for layer in linear]
    biases[0] = biases[0] - weights[0] @ (net.norm.running_mean * scale).double()
    weights[0] = weights[0] * scale.double()
    nodes, values, at = [], [], "profiles"
    for number, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        names = f"weight{number}", f"bias{number}"
        values += [
            numpy_helper.from_array(part.float().numpy(), name)
            for part, name in zip((weight, bias), names, strict=True)
        ]
        last = number == len(weights) - 1
        out = "too_deep" if last else f"sum{number}"
        nodes.append(helper.make_node("Gemm", [at, *names], [out], transB=1))
        if not last:
            at = f"hidden{number}"
            nodes.append(helper.make_node("Relu", [out], [at]))
    graph = helper.make_graph(
        nodes,
        "rpe",
        [helper.make_tensor_value_info("profiles", TensorProto.FLOAT, ["n", PROFILE_VALUES])],
        [helper.make_tensor_value_info("too_deep", TensorProto.FLOAT, ["n", 1])],
        values,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.checker.check_model(model)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(model.SerializeToString())
    print(f"{file}: {file.stat().st_size / 1e6:.2f} MB", flush=True)


def main() -> None:
    """Train it with a U-Net that is trained already."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("toml", type=Path, nargs="?", default=TOML, help="TOML file of the U-Net")
    write_profile_net(parser.parse_args().toml)


if __name__ == "__main__":
    main()
