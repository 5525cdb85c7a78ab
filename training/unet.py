"""The network: a small U-Net that works at half its input's size and rearranges its channels into pixels."""

from itertools import pairwise

import torch
from torch import Tensor, nn

__all__ = ["SmallUNet"]

WIDTHS = (12, 16, 24, 40, 56)
"""Channels at 1/2, 1/4, 1/8, 1/16 and 1/32 of the image's size."""

LEAK = 0.1


def conv_block(n_in: int, n_out: int, stride: int = 1, leak: float = 0.0) -> nn.Sequential:
    """Return one convolutional layer; its normalisation is folded in on export."""
    return nn.Sequential(
        nn.Conv2d(n_in, n_out, 3, stride, 1, bias=False),
        nn.BatchNorm2d(n_out),
        nn.LeakyReLU(leak, inplace=True) if leak else nn.ReLU(inplace=True),
    )


class SmallUNet(nn.Module):
    """Map grey images (n, 1, h, w) in [0, 1] to logits (n, classes, h, w); h and w are multiples of 32.

    Args:
        classes: Number of classes.
    """

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.gather, self.spread = nn.PixelUnshuffle(2), nn.PixelShuffle(2)
        self.larger = nn.Upsample(scale_factor=2, mode="nearest")
        self.down = nn.ModuleList(
            nn.Sequential(conv_block(n_in, n_out, 1 if n_in == 4 else 2), conv_block(n_out, n_out))
            for n_in, n_out in zip((4, *WIDTHS[:-1]), WIDTHS, strict=True)
        )
        upwards = WIDTHS[::-1]
        # The last features must not all be zero: a rare class, the needle, would be stuck there.
        self.up = nn.ModuleList(
            conv_block(deep + skip, skip, leak=LEAK if skip == WIDTHS[0] else 0.0)
            for deep, skip in pairwise(upwards)
        )
        self.last = nn.Conv2d(WIDTHS[0], 4 * classes, 1)

    def forward(self, image: Tensor) -> Tensor:
        """Return the logits."""
        skips, at = [], self.gather(image)
        for block in self.down:
            at = block(at)
            skips.append(at)
        for block, skip in zip(self.up, reversed(skips[:-1]), strict=True):
            at = block(torch.cat((self.larger(at), skip), 1))
        return self.spread(self.last(at))
