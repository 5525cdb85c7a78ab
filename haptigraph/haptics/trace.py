"""A device made of a file: every amplitude the hand would have felt, with its moment, and a plot of it."""

import csv
from pathlib import Path

from haptigraph.errors import BadInput
from haptigraph.messages import Capabilities

__all__ = ["TraceDevice"]


class TraceDevice:
    """Write stamp_ns, amplitude, frequency_hz at every change; plot the run beside the file on close.

    Args:
        path: The CSV file to write.

    Raises:
        BadInput: If it exists or cannot be written.
    """

    capabilities = Capabilities(amplitude_levels=65535, frequency_range_hz=(0.0, 1000.0), shortest_on_ms=0.0)

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)
        self._rows: list[tuple[int, float]] = []
        try:
            self._file = self._path.open("x", newline="", encoding="utf-8", buffering=1)
        except FileExistsError:
            raise BadInput("exists already; a trace never overwrites a file", path) from None
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", path) from None
        self._csv = csv.writer(self._file)
        self._csv.writerow(("stamp_ns", "amplitude", "frequency_hz"))

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Write one change."""
        self._csv.writerow((stamp_ns, amplitude, frequency_hz))
        self._rows.append((stamp_ns, amplitude))

    def close(self) -> None:
        """Close the file and plot it."""
        if self._file.closed:
            return
        self._file.close()
        if self._rows:
            self._plot()

    def _plot(self) -> None:
        from matplotlib.figure import Figure  # noqa: PLC0415 - slow to import, needed once

        start_ns = self._rows[0][0]
        figure = Figure(figsize=(10, 2.2), layout="constrained")
        axes = figure.subplots()
        axes.fill_between(
            [(stamp_ns - start_ns) / 1e9 for stamp_ns, _ in self._rows],
            [amplitude for _, amplitude in self._rows],
            step="post",
            color="#b5482a",
            linewidth=0,
        )
        axes.set(xlabel="time [s]", ylabel="amplitude", ylim=(0, 1.05), title="What the hand felt")
        axes.spines[["top", "right"]].set_visible(False)
        figure.savefig(self._path.with_suffix(".png"), dpi=150)
