"""Draw a vibration: amplitude and frequency over time."""

import itertools
from pathlib import Path

from haptigraph.analysis.plots.paper import check_new, save, styled
from haptigraph.analysis.touch.loading import Touch
from haptigraph.figures import Axes, Figure
from haptigraph.haptics.formats.curve import value_after, value_before
from haptigraph.haptics.formats.envelope import TRANSIENT_MS, plain

__all__ = ["draw_touch"]

WIDTH_IN, HEIGHT_IN = 5.5, 2.8
INK, TRANSIENT_INK = "#1f5f8b", "#c2571a"


def draw_touch(touch: Touch, output: str | Path) -> None:
    """Draw a vibration to a new SVG, PNG or PDF file.

    Raises:
        BadInput: If the file exists, or its format is unknown.
    """
    path = check_new(output)
    with styled():
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
        _draw_amplitude(upper, touch)
        _draw_frequency(lower, touch)
        save(figure, path)


def _draw_amplitude(axes: Axes, touch: Touch) -> None:
    envelope = touch.envelope
    seconds = [time_ms / 1e3 for time_ms, _ in envelope.amplitude]
    axes.fill_between(seconds, [value for _, value in envelope.amplitude], color=INK, alpha=0.25, linewidth=0)
    axes.plot(seconds, [value for _, value in envelope.amplitude], color=INK, linewidth=1.0)
    for number, one in enumerate(envelope.transients):
        span_s = one.time_ms / 1e3, (one.time_ms + TRANSIENT_MS) / 1e3
        axes.fill_between(
            span_s,
            [one.amplitude] * 2,
            color=TRANSIENT_INK,
            alpha=0.7,
            linewidth=0,
            label=f"transients, played for {TRANSIENT_MS:g} ms" if number == 0 else "_",
        )
    if envelope.transients:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, borderpad=0)
    axes.set_ylim(0, 1.05)
    axes.set_ylabel("amplitude")
    axes.set_title(f"{touch.name}{', repeats' if envelope.repeats else ''}", loc="left")


def _draw_frequency(axes: Axes, touch: Touch) -> None:
    """Draw the frequency where something vibrates."""
    envelope = plain(touch.envelope)
    end_ms = envelope.duration_ms
    axes.set_xlim(0, end_ms / 1e3)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("frequency (Hz)")
    times_ms = sorted(
        {time_ms for curve in (envelope.amplitude, envelope.frequency_hz) for time_ms, _ in curve}
    )
    highest_hz = 0.0
    for start_ms, until_ms in itertools.pairwise(times_ms):
        levels = value_after(envelope.amplitude, start_ms), value_before(envelope.amplitude, until_ms)
        hertz = value_after(envelope.frequency_hz, start_ms), value_before(envelope.frequency_hz, until_ms)
        if any(levels) and all(hertz):
            axes.plot(
                [start_ms / 1e3, until_ms / 1e3], hertz, color=INK, linewidth=1.5, solid_capstyle="butt"
            )
            highest_hz = max(highest_hz, *hertz)
    if highest_hz:
        axes.set_ylim(0, 1.15 * highest_hz)
    else:
        axes.set_yticks([])
        axes.text(0.5, 0.5, "the device's choice", transform=axes.transAxes, ha="center", va="center")
