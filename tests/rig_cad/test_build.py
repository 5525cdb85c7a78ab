"""Every shipped rig builds, with all its files. `make test-rig` runs them."""

import csv
import re
from pathlib import Path

import pytest

pytest.importorskip("build123d", reason="CAD has an environment of its own: make test-rig")

import trimesh
from build123d import import_step

from rig.build import build, main

RIGS = sorted((Path(__file__).parents[2] / "rig").glob("*.toml"))
DIRECT = "direct"


def file_of(name, tmp_path):
    """A shipped rig; or one without a mirror."""
    if name != DIRECT:
        return next(file for file in RIGS if file.stem == name)
    text = next(file for file in RIGS if file.stem == "d405").read_text()
    before, after = text.split("[[mirror]]")
    file = tmp_path / "direct.toml"
    light = after[after.index("[light]") :]
    file.write_text(before.replace("[camera]", "direct_mm = 85.0\n\n[camera]") + light)
    return file


@pytest.mark.parametrize("name", [*(file.stem for file in RIGS), DIRECT])
def test_a_rig_builds_with_all_its_files(name, tmp_path):
    folder = build(file_of(name, tmp_path), tmp_path / "out")

    with (folder / "bom.csv").open() as file:
        rows = list(csv.DictReader(file))
    printed = {
        row["item"].replace(" ", "_"): int(row["quantity"])
        for row in rows
        if row["note"].startswith("printed")
    }
    assert {"eye", "retina", "target", "frame", "camera_mount", "light", "base", "clip"} <= set(printed)
    for part in printed:
        mesh = trimesh.load(folder / "parts" / f"{part}.stl")
        assert mesh.is_watertight
        assert mesh.bounds[0][2] == pytest.approx(0, abs=1e-4)
        solid = import_step(folder / "parts" / f"{part}.step")
        assert solid.volume == pytest.approx(mesh.volume, rel=0.01)
        drawing = (folder / "drawings" / f"{part}.svg").read_text()
        lengths_mm = [float(text) for text in re.findall(r">([\d.]+)</text>", drawing)]
        for side_mm in mesh.extents:
            assert any(length_mm == pytest.approx(side_mm, abs=0.05) for length_mm in lengths_mm), (
                part,
                side_mm,
            )
        assert (folder / "drawings" / f"{part}.pdf").read_bytes().startswith(b"%PDF")
    assembly = import_step(folder / "assembly.step")
    names = {path.stem for path in (folder / "meshes").glob("*.stl")}  # what a renderer sees
    assert len(assembly.solids()) == len(names)
    screws = sum(int(row["quantity"]) for row in rows if row["item"].startswith("screw"))
    assert screws == sum(name.startswith("screw") for name in names)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {name}
    assert ("mirror" in names) == (name != DIRECT)


def test_a_file_that_does_not_exist_is_one_sentence_and_exit_code_2(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("sys.argv", ["rig.build", str(tmp_path / "none.toml")])

    with pytest.raises(SystemExit) as ended:
        main()

    assert ended.value.code == 2
    assert (
        capsys.readouterr().err
        == f"rig: {tmp_path / 'none.toml'}: cannot be read (No such file or directory)\n"
    )
