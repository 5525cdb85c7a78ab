"""The checks of a rig find every sabotage, and nothing else. `make test-rig` runs them."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("build123d", reason="CAD has an environment of its own: make test-rig")

import trimesh
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.rig.description import load_rig
from rig.assembly import bodies_of
from rig.build import build
from rig.checks import fits, light_path, overhangs, surfaces
from rig.layout import layout_of
from rig.meshes import mesh_of, on_bed
from rig.parts import eye, mirror_mount, retina
from rig.standard import SLIDE_MM, Print

D405 = Path(__file__).parents[2] / "rig" / "d405.toml"
RIG = load_rig(D405)
UPRIGHT = Print(up=(0, 0, 1), lies_on="its bottom")


@pytest.fixture(scope="module")
def layout():
    return layout_of(RIG, D405)


@pytest.fixture(scope="module")
def bodies(layout):
    return {body.name: body for body in bodies_of(layout)}


@pytest.fixture(scope="module")
def meshes(bodies):
    return {name: mesh_of(body.shape) for name, body in bodies.items()}


def moved(mesh, *by_mm):
    copy = mesh.copy()
    copy.apply_translation(by_mm)
    return copy


def gap_faults(bodies, meshes, *names, **changed):
    parts = {name: changed.get(name, meshes[name]) for name in names}
    return fits.faults_of(fits.gaps_of([bodies[name] for name in names], parts, board=False))


def changed_layout(**tables):
    return layout_of(replace(RIG, **tables), D405)


def test_every_kind_of_body_is_related_to_another(bodies):
    kinds = {body.kind for body in bodies.values()}
    related = {kind for pair in [*fits.FITS, *fits.JOINTS] for kind in pair}

    assert related <= kinds
    assert kinds - related == {"screw"}


def test_a_retina_that_is_too_thick_has_too_little_play(bodies, meshes):
    thick = mesh_of(retina.build(changed_layout(eye=replace(RIG.eye, retina_mm=1.3))))

    (gap,) = fits.gaps_of(
        [bodies["eye"], bodies["retina"]], {"eye": meshes["eye"], "retina": thick}, board=False
    )

    assert gap.gap_mm == pytest.approx(0.1, abs=fits.ACCURACY_MM)
    assert gap.fault.startswith("the play between eye and retina is 0.")
    assert gap.fault.endswith("it must be 0.20 mm")


def test_a_part_that_was_shifted_into_another_overlaps_it(bodies, meshes):
    (fault,) = gap_faults(bodies, meshes, "eye", "retina", retina=moved(meshes["retina"], 0, -0.5, 0))

    assert "eye and retina overlap by" in fault


def test_a_mirror_that_is_too_thin_for_its_slot_is_found(bodies, meshes):
    thin = changed_layout(mirrors=(replace(RIG.mirrors[0], thickness_mm=2.5, size_mm=(49.0, 49.0)),))

    (fault,) = gap_faults(
        bodies,
        meshes,
        "mirror",
        "mirror_mount",
        mirror=moved(mesh_of(mirror_mount.mirror(thin)), 0, 0.3, 0.3),
    )

    assert "the play between mirror and mirror_mount" in fault


def test_a_post_that_floats_above_the_base_is_found(bodies, meshes):
    (fault,) = gap_faults(bodies, meshes, "base", "post_1", post_1=moved(meshes["post_1"], 0, 1, 0))

    assert fault == "base and post_1 are 1.00 mm apart; they must touch where they are screwed together"


def test_parts_that_have_nothing_to_do_with_each_other_keep_their_distance(bodies, meshes):
    (fault,) = gap_faults(
        bodies, meshes, "frame", "light", light=moved(meshes["light"], 0, 0, frame_gap_mm(meshes) - 0.1)
    )

    assert fault == "frame and light are 0.10 mm apart; at least 0.3 mm are needed"


def frame_gap_mm(meshes):
    """How far the light is to move so that it would touch the frame."""
    return meshes["frame"].bounds[1][2] - meshes["light"].bounds[0][2] + 0.2


def test_a_screw_that_is_too_long_for_its_hole_is_found(bodies, meshes):
    faults = gap_faults(
        bodies, meshes, "eye", "frame", "screw_18", screw_18=moved(meshes["screw_18"], 0, 0, 4)
    )

    assert any("screw_18 overlap" in fault for fault in faults)


def test_a_surface_with_a_hole_is_not_closed(meshes):
    mesh = meshes["eye"].copy()
    mesh.update_faces(np.arange(len(mesh.faces)) != 100)

    assert surfaces.watertight_faults("eye", mesh) == [
        "eye: its surface is not closed; a printer needs a watertight mesh"
    ]


def test_a_surface_that_is_inside_out_is_found(meshes):
    mesh = meshes["target"].copy()
    mesh.invert()

    assert surfaces.watertight_faults("target", mesh) != []


def test_a_part_in_two_pieces_is_found(meshes):
    both = trimesh.util.concatenate([meshes["target"], moved(meshes["target"], 20, 0, 0)])

    assert surfaces.watertight_faults("target", both) == ["target: it is in 2 pieces; a part must be one"]


def test_a_wall_that_is_too_thin_is_found_and_an_edge_is_not():
    thin = surfaces.wall_faults("plate", trimesh.creation.box((30, 30, 0.9)), UPRIGHT)

    assert thin == [f"plate: {thin[0].split()[1]} mm² of wall is thinner than 1.2 mm, down to 0.90 mm"]
    assert surfaces.wall_faults("plate", trimesh.creation.box((30, 30, 1.2)), UPRIGHT) == []
    assert surfaces.wall_faults("cone", trimesh.creation.cone(10, 10), UPRIGHT) == []


def test_an_eye_with_a_thin_wall_is_found():
    thin = mesh_of(eye.build(changed_layout(eye=replace(RIG.eye, wall_mm=0.9))))

    (fault,) = surfaces.wall_faults("eye", thin, eye.PRINT)

    assert "of wall is thinner than 1.2 mm" in fault


def test_a_part_that_is_larger_than_the_bed_is_found():
    assert surfaces.bed_faults("plate", trimesh.creation.box((250, 100, 5)), UPRIGHT) == [
        "plate: 250 x 100 x 5 mm as printed; the bed takes 210 x 210 x 200 mm"
    ]
    assert surfaces.bed_faults("plate", trimesh.creation.box((210, 210, 200)), UPRIGHT) == []


def test_a_part_in_the_wrong_orientation_hangs_over(bodies, meshes):
    frame = bodies["frame"]
    as_stated, upright = frame.print, replace(frame.print, up=(0, 0, 1))

    assert overhangs.faults_of("frame", overhangs.overhangs_of(meshes["frame"], as_stated), as_stated) == []
    (fault,) = overhangs.faults_of("frame", overhangs.overhangs_of(meshes["frame"], upright), upright)
    assert fault.startswith("frame: ")
    assert "overhangs beyond 45°" in fault


def test_a_mask_without_supports_hangs_over(bodies, meshes):
    bare = replace(bodies["mask"].print, supports="")

    assert overhangs.faults_of("mask", overhangs.overhangs_of(meshes["mask"], bare), bare) != []


@pytest.mark.parametrize(("lean_deg", "count"), [(44, 0), (46, 1)])
def test_overhangs_begin_beyond_45_degrees(lean_deg, count):
    lean = np.tan(np.radians(lean_deg))
    slab = trimesh.creation.box((20, 20, 20))
    slab.vertices[:, 0] += lean * (slab.vertices[:, 2] + 10)

    assert len(overhangs.overhangs_of(slab, UPRIGHT)) == count


def in_rig(bodies, meshes):
    return {name: mesh for name, mesh in meshes.items() if bodies[name].group == "rig"}


def test_nothing_is_in_the_sound_light_path(layout, bodies, meshes):
    assert light_path.faults_of(layout, in_rig(bodies, meshes)) == []
    assert light_path.instrument_faults(layout, in_rig(bodies, meshes)) == []


def test_a_mirror_that_is_too_small_is_found(bodies, meshes):
    small = changed_layout(mirrors=(replace(RIG.mirrors[0], size_mm=(14.0, 50.0)),))

    (fault,) = light_path.faults_of(small, in_rig(bodies, meshes))

    assert fault.startswith("the mirror is too small: ")


def test_a_part_between_section_and_camera_is_found(layout, bodies, meshes):
    shifted = in_rig(bodies, meshes) | {"light": moved(meshes["light"], 0, 25, 0)}

    (fault,) = light_path.faults_of(layout, shifted)

    assert fault.startswith("light is between the section and the camera")


def test_a_mask_in_the_way_of_an_instrument_is_found(layout, bodies, meshes):
    shifted = in_rig(bodies, meshes) | {"mask": moved(meshes["mask"], 25, 0, 0)}

    faults = light_path.instrument_faults(layout, shifted)

    assert faults == ["mask is in the way of an instrument in port 2 that swings by 10°"]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("from_section_mm = 35.0", "from_section_mm = 22.0", "overlap"),
        ("from_section_mm = 12.0", "from_section_mm = 30.0", "light"),
        ("[light]", "[light]\nfrom_section = 3", "unknown key"),
        ("to_camera_mm = 45.0", 'to_camera_mm = 45.0\nturns = "left"', "turns the path left"),
    ],
)
def test_a_rig_with_a_fault_is_refused_and_nothing_is_written(tmp_path, old, new, sentence):
    file = tmp_path / "sabotaged.toml"
    assert D405.read_text().count(old) == 1
    file.write_text(D405.read_text().replace(old, new))

    with pytest.raises(BadInput, match=sentence) as refused:
        build(file, tmp_path / "out")

    assert str(refused.value).startswith(str(file))
    assert not (tmp_path / "out").exists()


def test_the_eye_is_where_the_description_says(layout, meshes):
    bowl, shell = meshes["eye"], meshes["retina"]
    radii = np.linalg.norm(shell.vertices, axis=1)

    assert bowl.bounds[0][2] == pytest.approx(layout.back_mm, abs=0.01)
    assert radii.min() == pytest.approx(layout.radius_mm, abs=0.02)
    assert shell.bounds[1][2] == pytest.approx(RIG.eye.cut_mm, abs=1e-3)
    rim = bowl.vertices[np.abs(bowl.vertices[:, 2] - RIG.eye.cut_mm) < 1e-3]
    assert np.hypot(*rim[rim[:, 1] > 0][:, :2].T).min() == pytest.approx(np.sqrt(12**2 - 0.6**2), abs=0.02)


def test_the_target_points_at_its_place_on_the_retina(layout, meshes):
    target = layout.on_globe(180 - RIG.eye.target_deg)
    nearest = meshes["target"].nearest.on_surface([target])[1][0]

    assert nearest < 0.01
    assert target[0] > 0


def test_parts_lie_on_the_bed(bodies, meshes):
    for name, body in bodies.items():
        if body.print:
            lying = on_bed(meshes[name], body.print)
            assert lying.bounds[0][2] == pytest.approx(0, abs=1e-9)
            assert lying.volume == pytest.approx(meshes[name].volume)


def test_play_is_what_the_page_states():
    assert SLIDE_MM == 0.2
