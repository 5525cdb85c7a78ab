"""Every notebook in examples/ runs from its first cell to its last, in a fresh kernel."""

import os
import shutil

import pytest
from helpers import mostly_slow
from paths import ROOT

NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))

nbclient = pytest.importorskip("nbclient")
nbformat = pytest.importorskip("nbformat")
pytest.importorskip("ipykernel")


def outputs_of(notebook) -> list[dict]:
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def test_there_is_a_notebook_for_every_use():
    assert [path.stem for path in NOTEBOOKS] == [
        "compare_two_procedures",
        "look_at_a_run",
        "perceiver_of_your_own",
        "table_of_a_study",
    ]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_is_committed_without_outputs(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert outputs_of(notebook) == []
    assert all(cell.execution_count is None for cell in notebook.cells if cell.cell_type == "code")
    assert "not a medical device" in notebook.cells[0].source


@pytest.mark.filterwarnings("default")  # of Jupyter's own libraries
@pytest.mark.parametrize(
    "path", mostly_slow(NOTEBOOKS, "perceiver_of_your_own.ipynb"), ids=lambda path: path.stem
)  # `make docs` runs them all
def test_it_runs(path, tmp_path, monkeypatch):
    for extra in ("pandas", "xarray", *(["sqlalchemy"] if path.stem == "table_of_a_study" else [])):
        pytest.importorskip(extra)
    shutil.copytree(path.parent, tmp_path, dirs_exist_ok=True)
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    for name in ("TMPDIR", "IPYTHONDIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(tmp_path / "jupyter"))
    (tmp_path / "jupyter").mkdir()
    notebook = nbformat.read(path, as_version=4)
    where = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=280, resources=where).execute()
    outputs = outputs_of(notebook)
    shown = {kind for output in outputs for kind in output.get("data", {})}
    assert {"text/html", "image/png"} <= shown
    warned = [output.text for output in outputs if output.get("name") == "stderr"]
    assert warned == []
