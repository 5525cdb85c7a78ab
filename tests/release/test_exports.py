"""The names that wheels must export are those of the library that is compiled here."""

import ctypes

from paths import ROOT

from release.exports import exported_names

NATIVE = ROOT / "haptigraph/perception/native"


def test_every_name_in_the_sources_is_in_the_library():
    library = ctypes.CDLL(str(NATIVE / "native.library"))

    names = exported_names(NATIVE)

    assert {"fit_line", "best_path", "needle_scores", "end_slant", "sources"} <= names
    assert all(ctypes.c_char.in_dll(library, name) is not None for name in names)
