"""Train the networks that ship with haptigraph, export them to ONNX, and write their report: `make train`.

Everything is seeded: the same machine with the same libraries gives the same network. Images for training,
validation and scoring are simulated with different seeds.
"""

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import torch
from torch import nn

from haptigraph.sim.oct.bscan import CLASSES
from training.data import SIDE_PX, Example, batches, draw, simulate
from training.onnx_file import write_onnx
from training.report import TrainingRun, write_report
from training.train_profiles import write_profile_net
from training.unet import SmallUNet

MODELS = Path(__file__).parent.parent / "haptigraph" / "models"
SEED = 8
TRAINING_SEED, VALIDATION_SEED = 100, 200
BATCH, RATE = 8, 4e-3
PROCESSORS = 2


def main() -> None:
    """Train, export, score."""
    args = parse_arguments()
    torch.manual_seed(SEED)
    torch.set_num_threads(PROCESSORS)  # another number changes the order of sums
    torch.use_deterministic_algorithms(True)
    start_s = time.monotonic()
    with ProcessPoolExecutor(PROCESSORS, get_context("spawn")) as pool:
        examples = list(pool.map(_training_example, range(args.examples), chunksize=10))
        validation = list(pool.map(_validation_example, range(args.examples // 20 + 1)))
    print(f"{len(examples)} B-scans simulated in {time.monotonic() - start_s:.0f} s", flush=True)
    file = args.output / "bscan_unet.onnx"
    train(examples, validation, args.steps, file)
    minutes = (time.monotonic() - start_s) / 60
    busy_minutes = sum(os.times()[:4]) / 60
    print(f"trained in {minutes:.1f} minutes, {busy_minutes:.1f} of them processor time", flush=True)
    if not args.no_report:
        write_profile_net(args.output / "bscan_unet.toml")
        run = TrainingRun(len(examples), args.steps, minutes, busy_minutes)
        write_report(args.output / "bscan_unet.toml", run)


def _training_example(number: int) -> Example:
    return simulate(number, TRAINING_SEED)


def _validation_example(number: int) -> Example:
    return simulate(number, VALIDATION_SEED)


def parse_arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--examples", type=int, default=1600, help="B-scans to simulate")
    parser.add_argument("--steps", type=int, default=3600, help="batches to train on")
    parser.add_argument("--output", type=Path, default=MODELS, help="folder of the network and its TOML")
    parser.add_argument(
        "--no-report", action="store_true", help="only the U-Net: no second network, no report"
    )
    return parser.parse_args()


def train(examples: list[Example], validation: list[Example], steps: int, file: Path) -> None:
    """Train a network for `steps` batches, exporting it to `file` along the way."""
    rng = np.random.default_rng(SEED)
    net = SmallUNet(len(CLASSES)).to(memory_format=torch.channels_last)
    print(f"{sum(weights.numel() for weights in net.parameters())} weights", flush=True)
    loss_function = nn.CrossEntropyLoss()  # not weighted, so that probabilities are calibrated
    optimizer = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=steps, pct_start=0.1)
    total, start_s = 0.0, time.monotonic()
    for number, (images, shares) in enumerate(batches(examples, BATCH, steps, rng), 1):
        optimizer.zero_grad()
        loss = loss_function(
            net(torch.from_numpy(images).contiguous(memory_format=torch.channels_last)),
            torch.from_numpy(shares),
        )
        loss.backward()
        optimizer.step()
        schedule.step()
        total += loss.item()
        if number % 100 == 0:
            elapsed_s = time.monotonic() - start_s
            print(f"{number:5} batches, loss {total / 100:.4f}, {elapsed_s:.0f} s", flush=True)
            total = 0.0
        if number % 500 == 0 or number == steps:
            print(f"      validation loss: {validation_loss(net, validation, loss_function):.4f}", flush=True)
            export(net, file)


def validation_loss(net: SmallUNet, examples: list[Example], loss_function: nn.Module) -> float:
    """Return the mean loss on validation images."""
    net.eval()
    rng = np.random.default_rng(SEED)
    losses = []
    with torch.no_grad():
        for example in examples:
            image, shares = (torch.from_numpy(part)[None] for part in draw(example, rng))
            losses.append(loss_function(net(image), shares).item())
    net.train()
    return float(np.mean(losses))


def export(net: SmallUNet, file: Path) -> None:
    """Write the network as it is now."""
    write_onnx(net, torch.zeros(1, 1, SIDE_PX, SIDE_PX), ("image", "logits"), file)


if __name__ == "__main__":
    main()
