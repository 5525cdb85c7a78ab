"""A file device: the time and value of every change of amplitude, and a plot of them."""

import csv
import warnings
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from haptigraph.errors import BadInput, DeviceError, MissingExtra, NotDrawn
from haptigraph.messages import Capabilities

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["TraceDevice"]

DEFAULT = "touch.csv"


class TraceDevice:
    """Write stamp_ns, amplitude, frequency_hz at every change; on close, plot the run next to the file.

    Without Matplotlib there is no plot, as a warning says.

    Args:
        path: The CSV file to write; touch.csv if empty.

    Raises:
        BadInput: If it or its plot exists, or it cannot be written.
    """

    capabilities = Capabilities(
        amplitude_levels=65535,
        frequency_range_hz=(0.0, 1000.0),
        shortest_on_ms=0.0,
        limitations="Every command is written unchanged; the plot needs the extra figures.",
    )

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path or DEFAULT)
        self._plot_path = self._path.with_suffix(".png")
        self._rows: list[tuple[int, float]] = []
        if self._path.suffix.lower() == ".png":
            raise BadInput("is the name of the trace's plot; give the trace another, for example x.csv", path)
        if self._plot_path.exists():
            problem = (
                "exists already, and the trace's plot needs this name; choose another name for the trace"
            )
            raise BadInput(problem, self._plot_path)
        try:
            self._file = self._path.open("x", newline="", encoding="utf-8", buffering=1)
        except FileExistsError:
            raise BadInput("exists already; choose the name of a new file", path) from None
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", path) from None
        try:
            self._csv = csv.writer(self._file)
            self._csv.writerow(("stamp_ns", "amplitude", "frequency_hz"))
        except BaseException:
            self._discard()
            raise

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Write one change."""
        try:
            self._csv.writerow((stamp_ns, amplitude, frequency_hz))
        except OSError as error:
            raise DeviceError(f"{self._path} cannot be written ({error.strerror})") from None
        self._rows.append((stamp_ns, amplitude))

    def close(self) -> None:
        """Close the file and plot it; delete the file if the device was never set."""
        if self._file.closed:
            return
        if not self._rows:
            self._discard()
            return
        self._file.close()
        try:
            from haptigraph.figures import Figure  # noqa: PLC0415 - slow to import, needed once
        except MissingExtra:
            missing = MissingExtra(f"{self._plot_path}, the plot of {self._path},", "figures")
            warnings.warn(str(missing), NotDrawn, stacklevel=2)
            return
        with self._plot_path.open("xb") as file:
            try:
                self._plot(Figure(figsize=(10, 2.2), layout="constrained"), file)
            except BaseException:
                self._plot_path.unlink()
                raise

    def _discard(self) -> None:
        with suppress(OSError):  # a full disk
            self._file.close()
        self._path.unlink()

    def _plot(self, figure: "Figure", file: BinaryIO) -> None:
        start_ns = self._rows[0][0]
        axes = figure.subplots()
        axes.fill_between(
            [(stamp_ns - start_ns) / 1e9 for stamp_ns, _ in self._rows],
            [amplitude for _, amplitude in self._rows],
            step="post",
            color="#b5482a",
            linewidth=0,
        )
        axes.set(xlabel="time [s]", ylabel="amplitude", ylim=(0, 1.05), title="Haptic output")
        axes.spines[["top", "right"]].set_visible(False)
        figure.savefig(file, format="png", dpi=150)
