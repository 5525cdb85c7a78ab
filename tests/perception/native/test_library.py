import re
import shutil
from pathlib import Path

import pytest

import haptigraph
from haptigraph.errors import NotCompiled
from haptigraph.perception.native import library
from haptigraph.perception.native.library import LIBRARY, Library

PACKAGE, NATIVE = Path(haptigraph.__file__).parent, Path(library.__file__).parent
FILE = NATIVE / "native.library"
TIP_NETWORK = Path(__file__).with_name("test_tip_network.py")


def test_a_missing_library_is_refused_in_a_sentence(tmp_path):
    with pytest.raises(
        NotCompiled, match=r"native.library, is missing; make it with: pip install . \(.*make setup\)"
    ):
        Library(tmp_path / "native.library")


def test_a_file_that_is_no_library_is_refused_in_a_sentence(tmp_path):
    (tmp_path / "native.library").write_text("int x;")
    with pytest.raises(NotCompiled, match=r"cannot be loaded \(.*\); make it with: pip install"):
        Library(tmp_path / "native.library")


def test_a_library_of_other_sources_is_refused(tmp_path):
    shutil.copy(FILE, tmp_path)
    Library(tmp_path / "native.library")  # as installed, without sources
    (tmp_path / "line.c").write_text("/* newer */")
    with pytest.raises(NotCompiled, match="other C sources than those beside it"):
        Library(tmp_path / "native.library")


@pytest.mark.parametrize(
    "fields",
    [
        (("d", "highlight highlight_sd images"),),
        (("d", "highlight_sd highlight images shaded_px"),),
        (("d", "highlight highlight_sd images shaded_px more"),),
        (("i", "highlight highlight_sd images shaded_px"),),
        (),
    ],
    ids=["a field less", "another order", "a field more", "another type", "none"],
)
def test_a_struct_that_is_laid_out_in_another_way_is_refused(fields):
    with pytest.raises(NotCompiled, match="lays Appearance out in another way than this version"):
        LIBRARY.layout("Appearance", *fields)


def test_a_name_that_the_library_lacks_is_refused():
    for ask in (LIBRARY.constant, lambda name: LIBRARY.function(name, "p")):
        with pytest.raises(NotCompiled, match="lacks no_such_thing; make it with"):
            ask("no_such_thing")


def test_each_function_has_exactly_one_wrapper_and_nothing_else_calls_c():
    def found(pattern: str, files) -> list[str]:
        return sorted(name for file in files for name in re.findall(pattern, file.read_text()))

    exported = found(r"EXPORT (?:int|double|void) (\w+)\(", NATIVE.rglob("*.[ch]"))
    functions = r'LIBRARY\.function\("(\w+)"'
    wrapped, of_tests = found(functions, NATIVE.glob("*.py")), found(functions, [TIP_NETWORK])
    assert sorted(wrapped + of_tests) == sorted(set(exported))
    others = [file for file in PACKAGE.rglob("*.py") if file.parent != NATIVE]
    assert found(r"(?:native\.library|native\.arrays|LIBRARY\.function|CDLL.*native)", others) == []


def test_structs_and_constants_are_those_of_the_header():
    header = "".join((NATIVE / name).read_text() for name in ("native.h", "oct/bscan.h"))
    constants = dict(re.findall(r"#define (\w+) (\d+)(?:\.0)? +/\*", header))
    assert {"BLOCK", "CELL", "MAX_LANES", "STATION_PX"} <= set(constants)
    assert {name: LIBRARY.constant(name) for name in constants} == {
        name: int(value) for name, value in constants.items()
    }
    exported = (NATIVE / "interface.c").read_text()
    for name in re.findall(r"SIZE\(([A-Z]\w+)\)", exported):
        body = re.search(rf"typedef struct {{([^}}]*)}} {name};", header)[1]
        body = re.sub(r"/\*.*?\*/", "", body, flags=re.DOTALL)
        fields = re.findall(r"(\w+)(?:\[\d+\])?[,;]", body)
        listed = re.search(rf"FIELD\({name}, field\)(.*?)(?:#undef|[{{]0[}}])", exported, re.DOTALL)[1]
        assert list(dict.fromkeys(re.findall(r"F\((\w+)", listed))) == fields
