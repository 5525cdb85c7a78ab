import csv
import io

import pytest
from helpers import MS

from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.console import ConsoleDevice
from haptigraph.haptics.trace import TraceDevice


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_console_draws_a_bar_in_a_terminal():
    terminal = Terminal()
    device = ConsoleDevice(stream=terminal)
    device.set(0.5, 80.0, 0)
    assert "██████████··········" in terminal.getvalue()
    assert "0.50 at  80 Hz" in terminal.getvalue()
    device.set(0.0, 0.0, 1)
    assert "silent" in terminal.getvalue()
    device.close()


def test_the_console_writes_nothing_without_a_terminal():
    stream = io.StringIO()
    device = ConsoleDevice(stream=stream)
    device.set(1.0, 80.0, 0)
    device.close()
    assert stream.getvalue() == ""


def test_a_trace_contains_every_change_and_is_plotted(tmp_path):
    file = tmp_path / "touch.csv"
    device = TraceDevice(file)
    device.set(0.3, 80.0, 5 * MS)
    device.set(0.0, 0.0, 50 * MS)
    device.close()
    device.close()
    with file.open() as rows:
        assert list(csv.reader(rows)) == [
            ["stamp_ns", "amplitude", "frequency_hz"],
            ["5000000", "0.3", "80.0"],
            ["50000000", "0.0", "0.0"],
        ]
    assert (tmp_path / "touch.png").stat().st_size > 1000


def test_a_trace_survives_a_kill(tmp_path):
    file = tmp_path / "touch.csv"
    device = TraceDevice(file)
    device.set(0.3, 80.0, 5)
    assert "5,0.3,80.0" in file.read_text()  # written before it is closed
    device.close()


def test_an_existing_trace_is_not_overwritten(tmp_path):
    file = tmp_path / "touch.csv"
    file.write_text("precious")
    with pytest.raises(BadInput, match="exists already; choose the name of a new file"):
        TraceDevice(file)
    assert file.read_text() == "precious"
    with pytest.raises(BadInput, match="cannot be written"):
        TraceDevice(tmp_path / "no" / "such" / "folder.csv")


def test_an_existing_plot_is_not_overwritten(tmp_path):
    plot = tmp_path / "touch.png"
    plot.write_text("precious")
    with pytest.raises(BadInput, match=r"touch\.png: exists already, and the trace's plot needs this name"):
        TraceDevice(tmp_path / "touch.csv")
    assert plot.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [plot]


def test_a_plot_that_appeared_meanwhile_is_not_overwritten(tmp_path):
    device = TraceDevice(tmp_path / "touch.csv")
    device.set(0.3, 80.0, 5)
    plot = tmp_path / "touch.png"
    plot.write_text("precious")
    with pytest.raises(FileExistsError):
        device.close()
    assert plot.read_text() == "precious"


@pytest.mark.parametrize("name", ["touch.png", "touch.PNG"])
def test_a_trace_with_the_name_of_its_own_plot_is_refused(tmp_path, name):
    with pytest.raises(BadInput, match="is the name of the trace's plot"):
        TraceDevice(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_an_unused_trace_leaves_no_file(tmp_path):
    TraceDevice(tmp_path / "touch.csv").close()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_reported_with_the_file(tmp_path, monkeypatch):
    device = TraceDevice(tmp_path / "touch.csv")

    class Full:
        def writerow(self, row):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(device, "_csv", Full())
    with pytest.raises(DeviceError, match=r"touch\.csv cannot be written \(No space left on device\)"):
        device.set(0.3, 80.0, 5)
    device.close()


def test_the_console_works_without_standard_error(monkeypatch):
    monkeypatch.setattr("sys.stderr", None)
    device = ConsoleDevice()
    device.set(0.3, 80.0, 0)
    device.close()
