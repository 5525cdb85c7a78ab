"""Read a dataset with LeRobot's own library, and save what it returns; runs in an environment of LeRobot's.

python read_lerobot.py DATASET OUT.npz: every feature of every item by name, images as 8-bit (n, h, w, 3).
"""

import sys

import numpy as np
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset

folder, output = sys.argv[1:]
dataset = LeRobotDataset("haptigraph/export", root=folder, video_backend="pyav")
assert len(dataset) == dataset.num_frames
items = [dataset[index] for index in range(len(dataset))]
images = dataset.meta.camera_keys
saved = {}
for key in items[0]:
    values = [item[key] for item in items]
    if key in images:
        pixels = torch.stack(values).permute(0, 2, 3, 1) * 255
        saved[key] = pixels.round().to(torch.uint8).numpy()
    else:
        saved[key] = np.array(
            [value.numpy() if isinstance(value, torch.Tensor) else value for value in values]
        )
for feature, statistics in dataset.meta.stats.items():
    for name, value in statistics.items():
        saved[f"stats/{feature}/{name}"] = np.asarray(value)
saved["episodes"] = np.array(
    [(one["dataset_from_index"], one["dataset_to_index"]) for one in dataset.meta.episodes]
)
loader = torch.utils.data.DataLoader(dataset, batch_size=4, num_workers=0)
batch = next(iter(loader))
assert batch["observation.state"].shape[0] == min(4, len(dataset))
part = LeRobotDataset(
    "haptigraph/export",
    root=folder,
    episodes=[dataset.num_episodes - 1],
    video_backend="pyav",
    delta_timestamps={"observation.state": [-1 / dataset.fps, 0.0]},
)
assert tuple(part[0]["observation.state"].shape[:1]) == (2,)
np.savez_compressed(output, **saved)
