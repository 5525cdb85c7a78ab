"""Train the network that judges by profiles of grey along an RPE where it is too deep.

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
import torch
from torch import Tensor, nn

from haptigraph.perception.oct.class_edges import PROFILE_VALUES, PROFILE_WIDTHS_MM
from haptigraph.perception.oct.onnx_model import OnnxModel
from training.onnx_file import write_onnx
from training.profiles import KINDS, Judged, judge, scene_of

__all__ = ["write_profile_net"]

TOML = Path(__file__).parent.parent / "haptigraph" / "models" / "bscan_unet.toml"
SEED = 10  # with 8 and 9 it doubts the RPE of real scans
HIDDEN, DROPOUT = (96, 24), (0.1, 0.2)
CONTEXT, ALONG, DISTANCES = 32, 5, (1, 3, 9)
"""Features of a column and its neighbours; number of columns that each layer compares, and their distance."""
EPOCHS, BATCH, RATE, DECAY = 18, 16, 3e-3, 1e-3
SAMPLES = PROFILE_VALUES // len(PROFILE_WIDTHS_MM)
BLURS = 1.0, 2.0, 3.0  # down a profile, standard deviation in samples; as many batches are not blurred
GAMMA_SD, GAIN_SD, OFFSET_SD = 0.25, 0.08, 0.03
HALF = 0.5
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
    """Map profiles in columns beside each other, (n, values), to the logit of being too deep, (n, 1).

    A lesion is larger than the part of it that a profile shows, so each column is judged with its neighbours,
    up to 26 on either side. Inputs are standardized by what it was trained on.
    """

    def __init__(self) -> None:
        super().__init__()
        first, second = HIDDEN
        self.norm = nn.BatchNorm1d(PROFILE_VALUES, affine=False)
        self.alone = nn.Sequential(
            nn.Dropout(DROPOUT[0]),
            nn.Conv1d(PROFILE_VALUES, first, 1),
            nn.ReLU(),
            nn.Dropout(DROPOUT[1]),
            nn.Conv1d(first, second, 1),
            nn.ReLU(),
        )
        self.widen = nn.Conv1d(second + 1, CONTEXT, 1)
        self.context = nn.ModuleList(
            nn.Conv1d(CONTEXT, CONTEXT, ALONG, padding=ALONG // 2 * distance, dilation=distance)
            for distance in DISTANCES
        )
        self.last = nn.Conv1d(CONTEXT, 1, 1)

    def forward(self, profiles: Tensor) -> Tensor:
        """Return the logits of one image, (n, 1)."""
        return self.judge(profiles.T[None])[0].T

    def judge(self, profiles: Tensor) -> Tensor:
        """Return the logits of a batch, (batch, 1, n), of profiles, (batch, values, n)."""
        is_likely = (profiles != 0).any(dim=1, keepdim=True).to(profiles.dtype)
        at = self.widen(torch.cat((self.alone(self.norm(profiles)) * is_likely, is_likely), 1))
        for layer in self.context:
            at = at + torch.relu(layer(at))
        return self.last(at)


def train(scans: list[Judged]) -> ProfileNet:
    """Train on all columns of all scans; the loss is not weighted, so that probabilities are calibrated."""
    inputs = torch.from_numpy(np.stack([scan.profiles().T for scan in scans]))
    is_learned, is_deep = (
        torch.from_numpy(np.stack([getattr(scan, name) for scan in scans]).astype(np.float32))[:, None]
        for name in ("is_learned", "is_deep")
    )
    share = (is_learned * is_deep).sum() / is_learned.sum()
    print(f"{is_learned.sum():.0f} columns, in {share:.1%} of which the RPE is too deep", flush=True)
    net = ProfileNet()
    steps = EPOCHS * (len(inputs) // BATCH)
    optimizer = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=steps, pct_start=0.1)
    loss_function = nn.BCEWithLogitsLoss(reduction="none")
    for epoch in range(EPOCHS):
        total = 0.0
        for chosen in _batches(len(inputs)):
            batch = inputs[chosen].float(), is_learned[chosen], is_deep[chosen]
            profiles, weight, target = (part.flip(-1) for part in batch) if torch.rand(1) < HALF else batch
            optimizer.zero_grad()
            loss = (loss_function(net.judge(varied(profiles)), target) * weight).sum() / weight.sum()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += loss.item()
        print(f"epoch {epoch + 1}, loss {total / (len(inputs) // BATCH):.4f}", flush=True)
    return net


def varied(profiles: Tensor) -> Tensor:
    """Vary sharpness, brightness and contrast as between devices, (batch, values, n)."""
    count, _, columns = profiles.shape
    is_likely = (profiles != 0).any(dim=1, keepdim=True)
    parts = profiles.view(count, -1, SAMPLES, columns)
    chosen = int(torch.randint(0, 2 * len(BLURS), (1,)))
    if chosen < len(BLURS):
        at = torch.arange(float(SAMPLES))
        weights = torch.exp(-((at[:, None] - at) ** 2) / (2 * BLURS[chosen] ** 2))
        parts = (weights / weights.sum(dim=1, keepdim=True)) @ parts
    if torch.rand(1) < HALF:
        parts = torch.clamp(parts, min=0) ** torch.exp(GAMMA_SD * torch.randn(count, 1, 1, 1))
    parts = parts * (1 + GAIN_SD * torch.randn(count, 1, 1, 1)) + OFFSET_SD * torch.randn(count, 1, 1, 1)
    return parts.reshape(profiles.shape) * is_likely


def _batches(count: int) -> Iterator[Tensor]:
    order = torch.randperm(count)
    for number in range(count // BATCH):
        yield order[number * BATCH : (number + 1) * BATCH]


def export(net: ProfileNet, file: Path) -> None:
    """Write the network; it takes any number of columns."""
    write_onnx(net, torch.ones(2 * ALONG, PROFILE_VALUES), ("profiles", "too_deep"), file, any_count=True)


def main() -> None:
    """Train it with a U-Net that is trained already."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("toml", type=Path, nargs="?", default=TOML, help="TOML file of the U-Net")
    write_profile_net(parser.parse_args().toml)


if __name__ == "__main__":
    main()
