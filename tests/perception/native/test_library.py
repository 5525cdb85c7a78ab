import shutil
from ctypes import c_float
from pathlib import Path

import numpy as np
import pytest

from haptigraph.errors import NotCompiled
from haptigraph.perception.native import library

LIBRARY = Path(library.__file__).with_name("native.library")
STRIP = np.arange(40 * 300, dtype=np.float32).reshape(40, 300)


def read_only() -> np.ndarray:
    array = np.zeros(5)
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    "array",
    [
        STRIP,
        STRIP[3:, 10:200],
        STRIP[::-1, ::2],
        STRIP.T,
        np.zeros((0, 4)),
        np.array(7, np.uint8),
        read_only(),
    ],
    ids=["whole", "part", "backwards", "turned", "empty", "one value", "read only"],
)
def test_an_address_is_where_the_values_lie(array):
    assert library.address(array) == array.ctypes.data


def test_an_address_is_where_the_values_of_a_file_lie(tmp_path):
    array = np.memmap(tmp_path / "values", np.float32, "w+", shape=(3, 4))
    assert library.address(array[1:]) == array.ctypes.data + 16


@pytest.mark.parametrize("part", [STRIP, STRIP[3:, 10:200], STRIP[::-2, 5:], STRIP[:, 7:8]])
def test_rows_lead_to_every_value(part):
    first, stride = library.rows(part)
    for lane, station in ((0, 0), (1, 0), (part.shape[0] - 1, part.shape[1] - 1)):
        value = c_float.from_address(first + 4 * (lane * stride + station)).value
        assert value == part[lane, station]


@pytest.mark.parametrize(
    ("array", "found"),
    [
        (STRIP.astype(float), r"\(40, 300\) of float64"),
        (STRIP.astype(">f4"), "of >f4"),
        (STRIP[0], r"\(300,\) of float32"),
        (STRIP.T, r"\(4, 1200\) bytes apart"),
        (STRIP[:, ::2], r"\(1200, 8\) bytes apart"),
    ],
    ids=["doubles", "turned bytes", "one row", "turned", "every other"],
)
def test_other_arrays_are_no_rows(array, found):
    with pytest.raises(ValueError, match=f"one value beside the other; found .*{found}"):
        library.rows(array)


def test_a_missing_library_is_told_in_a_sentence(tmp_path):
    with pytest.raises(
        NotCompiled, match=r"native.library, is missing; make it with: pip install . \(.*make setup\)"
    ):
        library._load(tmp_path / "native.library")


def test_what_is_no_library_is_told_in_a_sentence(tmp_path):
    (tmp_path / "native.library").write_text("int x;")
    with pytest.raises(NotCompiled, match=r"cannot be loaded \(.*\); make it with: pip install"):
        library._load(tmp_path / "native.library")


def test_a_library_of_other_sources_is_refused(tmp_path):
    shutil.copy(LIBRARY, tmp_path)
    library._load(tmp_path / "native.library")  # as installed, without sources
    (tmp_path / "line.c").write_text("/* newer */")
    with pytest.raises(NotCompiled, match="other C sources than those beside it"):
        library._load(tmp_path / "native.library")
