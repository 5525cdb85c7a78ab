"""Train the network that finds a needle's tip in the pixels along its shaft: `make train-tip`.

It learns from simulated scenes, and from rendered scenes drawn by lot (`make render-tips`), each degraded in
several ways. Everything is seeded: the same machine with the same libraries gives the same network. It is
written as one array of numbers, in the order of `TipWeights` in `tip_network.h`.
"""

import argparse
import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from haptigraph.perception.native.tip_network import PLACES, STATIONS, VALUES
from rendering.lot import LEARNED
from training.tip_rendered import check_rendered, of_drawn
from training.tip_shape import (
    ACROSS,
    BEHIND,
    CHANNELS,
    CONTEXT,
    FEATURES,
    FILE,
    LAYERS,
    MIN_SD_PX,
    PLACE_SD_MM,
    STEP_MM,
    STEP_SD_PX,
    TAPS,
    USUAL_PX_PER_MM,
)
from training.tip_windows import Windows, of_scene

__all__ = ["TipNet", "train", "write"]

SEED = 26
SCENES = 66
SIZES_PX = {
    **dict.fromkeys(range(601, 605), (1280, 720)),
    605: (640, 360),
    **dict.fromkeys((606, 609), (400, 225)),
}
"""Image sizes of the simulated scenes, by seed."""
SHAFT, COLOR_SHARE, MAX_VALUE = BEHIND - 4, 0.5, 4.0
SHARES = 0.6, 0.4  # of a batch: rendered and simulated windows
BATCH, STEPS, RATE, DECAY = 128, 12_000, 4e-3, 1e-3
KIND_SHARES = 0.6, 0.25, 0.15  # of windows at selected tips, near them, and further off
ELSEWHERE_MM = 10.0  # how wide *none of the places* is
MAX_NOISE, COLOR_NOISE = 0.15, 1.4  # of the contrast; of the colour, in that of the grey
COLOR_IN_GREY = 0.7  # standard deviation of the share of the colour that is added to the grey
MAX_SCALE, MAX_LIGHT = 0.3, 0.6  # logarithm of a scale; change of the contrast along a shaft
HALF, NEARLY = 0.5, 0.99
COLORS = 0.0, 0.5, 1.0, 1.0, 1.5  # what the colour is multiplied by
PROCESSORS = 2


class TipNet(nn.Module):
    """Map windows to logits, (n, KINDS): a tip at each place, at none, and at the step, in two precisions."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Conv1d(CHANNELS * ACROSS + 1 + CONTEXT + 1, FEATURES, 1)
        self.layers = nn.ModuleList(
            nn.Conv1d(FEATURES, FEATURES, TAPS, padding=(TAPS // 2) << n, dilation=1 << n)
            for n in range(LAYERS)
        )
        self.place = nn.Conv1d(FEATURES, 1, 1)
        self.elsewhere = nn.Linear(FEATURES, 1)
        self.step = nn.Linear(FEATURES, len(STEP_SD_PX))

    def forward(self, values: Tensor, context: Tensor) -> Tensor:
        """Return the logits.

        Args:
            values: Windows, (n, VALUES).
            context: Noise [grey levels], scale [px per mm], and the steps' standard deviations [px], (n, 3).
        """
        count = CHANNELS * ACROSS
        rows = values.reshape(len(values), count + 1, STATIONS)
        contrast = rows[:, :count].reshape(len(rows), CHANNELS, ACROSS, STATIONS)[..., :SHAFT]
        contrast = contrast.square().mean((2, 3)).sqrt()
        unit = contrast[:, 0] + COLOR_SHARE * contrast[:, -1] + 1
        seen = (rows[:, :count] / unit[:, None, None]).clamp(-MAX_VALUE, MAX_VALUE)
        noise_grey, px_per_mm, sd_px = context.T
        whole = (noise_grey + 1) / unit, px_per_mm / USUAL_PX_PER_MM, sd_px + MIN_SD_PX
        rest = torch.stack(whole, 1).log()[:, :, None].expand(-1, -1, STATIONS)
        is_step = (torch.arange(STATIONS) == BEHIND).float().expand(len(rows), 1, -1)
        at = torch.relu(self.first(torch.cat((seen, rows[:, count:], rest, is_step), 1)))
        for layer in self.layers:
            at = at + torch.relu(layer(at))
        places = self.place(at)[:, 0, BEHIND - PLACES // 2 : BEHIND + PLACES // 2]
        return torch.cat((places, self.elsewhere(at.amax(2)), self.step(at[:, :, BEHIND])), 1)


def main() -> None:
    """Make the windows, train, and write the weights."""
    args = parse_arguments()
    check_rendered("train_tip", LEARNED, "render-tips")
    torch.manual_seed(SEED)
    torch.set_num_threads(PROCESSORS)  # another number changes the order of sums
    torch.use_deterministic_algorithms(True)
    with ProcessPoolExecutor(PROCESSORS, get_context("spawn")) as pool:
        rendered = joined(pool.map(of_drawn, LEARNED))
        simulated = joined(pool.map(_of_scene, product(range(SCENES), SIZES_PX.items()), chunksize=11))
    print("rendered and simulated windows:", len(rendered.values), len(simulated.values), flush=True)
    write(train((rendered, simulated), args.steps), args.output)


def parse_arguments() -> argparse.Namespace:
    """Return the parsed command line."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: python -m training.train_tip --steps 500 --output quick.npy",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--output", type=Path, default=FILE, help="file to write (default: the shipped one)")
    parser.add_argument("--steps", type=int, default=STEPS, help=f"of training (default: {STEPS})")
    return parser.parse_args()


def _of_scene(given: tuple[int, tuple[int, tuple[int, int]]]) -> Windows | None:
    number, (seed, size_px) = given
    return of_scene(number, seed, size_px)


def joined(parts: Iterable[Windows | None]) -> Windows:
    """Return all windows together."""
    found = [part for part in parts if part is not None]
    return Windows(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


def train(parts: Sequence[Windows], steps: int, seed: int = SEED) -> TipNet:
    """Train a network on all parts, in the proportion of `SHARES`."""
    rng, net = np.random.default_rng(seed), TipNet()
    optimizer = torch.optim.AdamW(net.parameters(), RATE, weight_decay=DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, steps)
    net.train()
    mean = 0.0
    for step in range(steps):
        values, context, beyond_mm = _batch(rng, parts)
        loss = -log_density(net(values, context), beyond_mm, context[:, 1]).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        mean += 0.02 * (float(loss.detach()) - mean)
        if step % 1000 == 999:
            print(f"step {step + 1}: loss {mean:.3f}", flush=True)
    return net.eval()


def _batch(rng: np.random.Generator, parts: Sequence[Windows]) -> tuple[Tensor, Tensor, Tensor]:
    """Draw windows, and vary what other needles, lights and cameras vary."""
    chosen = [(part, _drawn_of(rng, part, share)) for part, share in zip(parts, SHARES, strict=True)]
    values, beyond_mm, context = (
        np.concatenate([part[field][at] for part, at in chosen]).astype(np.float32) for field in range(3)
    )
    rows = values.reshape(BATCH, CHANNELS * ACROSS + 1, STATIONS)
    seen, is_inside = rows[:, :-1].reshape(BATCH, CHANNELS, ACROSS, STATIONS), rows[:, -1]
    seen, is_inside, along = _scaled(rng, seen, is_inside)
    shares = rng.normal(0, COLOR_IN_GREY, BATCH) * (rng.random(BATCH) < HALF)
    seen[:, :2] += shares.astype(np.float32)[:, None, None, None] * seen[:, 2:]
    seen *= rng.choice([-1, 1], (BATCH, 2))[:, [0, 0, 1], None, None]
    seen[:, 2] *= rng.choice(COLORS, BATCH)[:, None, None]
    seen *= _light(rng)[:, None, None]
    contrast = np.sqrt(np.square(seen[:, 0, :, :SHAFT]).mean((1, 2))) + 1
    added = contrast * rng.uniform(0, MAX_NOISE, BATCH) * (rng.random(BATCH) < HALF)
    for channels, share in ((slice(0, 2), 1.0), (slice(2, 3), COLOR_NOISE)):
        noise = rng.standard_normal((BATCH, 1, ACROSS, STATIONS), np.float32)
        seen[:, channels] += share * added.astype(np.float32)[:, None, None, None] * noise
    seen *= is_inside[:, None, None]
    rows = np.concatenate([seen.reshape(BATCH, -1, STATIONS), is_inside[:, None]], 1).astype(np.float32)
    context[:, 0] = np.hypot(context[:, 0], added)
    whole = torch.from_numpy(rows.reshape(BATCH, VALUES)), torch.from_numpy(context)
    return *whole, torch.from_numpy(beyond_mm * along)


def _drawn_of(rng: np.random.Generator, part: Windows, share: float) -> NDArray[np.int64]:
    """Draw windows of a part, some at selected tips, others beside them."""
    count = round(share * BATCH)
    kinds = rng.choice(len(KIND_SHARES), count, p=KIND_SHARES)
    return rng.integers(len(part.values) // len(KIND_SHARES), size=count) * len(KIND_SHARES) + kinds


def _scaled(
    rng: np.random.Generator, seen: NDArray[np.float32], is_inside: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Make needles thicker or thinner, points longer or shorter, mirror some; return by how much along."""
    along, across = np.exp(rng.uniform(-MAX_SCALE, MAX_SCALE, (2, BATCH))).astype(np.float32)
    sides = across * rng.choice([-1, 1], BATCH).astype(np.float32)
    station = torch.linspace(0, STATIONS - 1, STATIONS)
    from_station = BEHIND + (station - BEHIND) / torch.from_numpy(along)[:, None]
    x = from_station / (STATIONS - 1) * 2 - 1
    y = torch.linspace(-1, 1, ACROSS) / torch.from_numpy(sides)[:, None]
    grid = torch.stack((x[:, None].expand(-1, ACROSS, -1), y[:, :, None].expand(-1, -1, STATIONS)), -1)
    whole = torch.from_numpy(np.concatenate([seen, np.repeat(is_inside[:, None, None], ACROSS, 2)], 1))
    found = functional.grid_sample(whole, grid, padding_mode="border", align_corners=True).numpy()
    inside = ((found[:, -1, 0] > NEARLY) & ((x.numpy() >= -1) & (x.numpy() <= 1))).astype(np.float32)
    return found[:, :-1].copy(), inside, along


def _light(rng: np.random.Generator) -> NDArray[np.float32]:
    """Return how the contrast changes along each shaft, by what it mirrors, (n, STATIONS)."""
    phase, waves = rng.uniform(0, 2 * np.pi, (BATCH, 1)), rng.uniform(0.3, 2.5, (BATCH, 1))
    share = rng.uniform(0, MAX_LIGHT, (BATCH, 1)) * (rng.random((BATCH, 1)) < HALF)
    return (1 + share * np.sin(phase + 2 * np.pi * waves * np.arange(STATIONS) / STATIONS)).astype(np.float32)


def log_density(logits: Tensor, beyond_mm: Tensor, px_per_mm: Tensor) -> Tensor:
    """Return the logarithm of the density of true tips, (n,)."""
    centers_mm = (torch.arange(PLACES) - PLACES // 2) * STEP_MM
    steps = [_log_normal(beyond_mm[:, None], sd_px / px_per_mm[:, None]) for sd_px in STEP_SD_PX]
    places = _log_normal(beyond_mm[:, None] - centers_mm, torch.tensor(PLACE_SD_MM))
    elsewhere = torch.full((len(logits), 1), -math.log(ELSEWHERE_MM))
    return torch.logsumexp(functional.log_softmax(logits, 1) + torch.cat((places, elsewhere, *steps), 1), 1)


def _log_normal(off_mm: Tensor, sd_mm: Tensor) -> Tensor:
    return -(off_mm / sd_mm).square() / 2 - torch.log(sd_mm * math.sqrt(2 * math.pi))


def write(net: TipNet, file: Path) -> None:
    """Write what it has learned in the order of `TipWeights`."""
    parts = [net.first.weight, net.first.bias, *(layer.weight for layer in net.layers)]
    parts += [*(layer.bias for layer in net.layers), net.place.weight, net.place.bias]
    parts += [net.elsewhere.weight, net.elsewhere.bias, net.step.weight, net.step.bias]
    np.save(file, torch.cat([part.detach().flatten() for part in parts]).numpy().astype(np.float32))


if __name__ == "__main__":
    main()
