import numpy as np
from helpers import call, refuse
from needle_volumes import VOXEL_MM, needle_volumes

from haptigraph.perception.instrument.model_file import load_instrument

SIZE = ",".join(map(str, VOXEL_MM))


def test_an_instrument_is_learned_from_a_folder(tmp_path):
    volumes, _ = needle_volumes(np.random.default_rng(9), 8)
    for number, volume in enumerate(volumes):
        np.savez(tmp_path / f"{number}.npz", data=volume)
    output = tmp_path / "models" / "needle.npz"
    command = ("register", "--volumes", tmp_path, "-o", output, "--voxel-mm", SIZE)
    assert "its folder does not exist" in refuse(*command)
    output.parent.mkdir()
    text = call(*command).output
    assert "an instrument learned from 8 of 8 volumes" in text
    assert load_instrument(output).voxel_mm == VOXEL_MM
    assert "--force overwrites it" in refuse(*command)


def test_wrong_options_are_refused_in_a_sentence(tmp_path):
    assert "either SOURCE or --volumes FOLDER" in refuse("register", "-o", "eye.toml")
    assert "--voxel-mm goes with --volumes" in refuse(
        "register", "eye.png", "-o", "e.toml", "--voxel-mm", SIZE
    )
    learning = ("register", "--volumes", tmp_path, "-o", tmp_path / "needle.npz")
    assert "--volumes goes with -o, --voxel-mm and --force only" in refuse(*learning, "--target", "1,2")
    assert "has no volumes" in refuse(*learning)
    assert "three lengths in mm" in refuse(*learning, "--voxel-mm", "1,2")
    assert "ends in .npz" in refuse("register", "--volumes", tmp_path, "-o", tmp_path / "needle.toml")
