"""Write a new file: never over another, and nothing of it remains if that fails."""

import builtins
import errno

import pytest

from haptigraph.analysis.exporting.writing import write_new
from haptigraph.errors import BadInput


def test_a_file_is_written_once(tmp_path):
    write_new(tmp_path / "a", b"first")
    with pytest.raises(BadInput, match="exists already"):
        write_new(tmp_path / "a", b"second")
    assert (tmp_path / "a").read_bytes() == b"first"


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(BadInput, match="cannot be written"):
        write_new(tmp_path / "no" / "a", b"content")


def test_a_full_disk_leaves_nothing(tmp_path, monkeypatch):
    def full(path, mode):
        file = open_before(path, mode, buffering=0)

        class Full:
            def __enter__(self):
                return self

            def __exit__(self, *_):
                file.close()

            def write(self, content):
                file.write(content[:2])
                raise OSError(errno.ENOSPC, "No space left on device")

        return Full()

    open_before = builtins.open
    monkeypatch.setattr(builtins, "open", full)
    with pytest.raises(BadInput, match="cannot be written \\(No space left on device\\)"):
        write_new(tmp_path / "a", b"content")
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == []
