import numpy as np
import pytest

from haptigraph.errors import BadInput
from haptigraph.perception.instrument.volume_folder import VolumeFolder

VOLUME = np.zeros((16, 3, 4), np.uint8)


def write(folder, name, **arrays):
    np.savez(folder / name, **{"data": VOLUME, "pos": np.arange(6.0), **arrays})


def test_volumes_come_in_the_order_of_their_time_stamps(tmp_path):
    for seconds in (1000.5, 99.25, 200.0):
        write(tmp_path, f"{seconds}.npz", data=np.full((16, 3, 4), int(seconds) % 256, np.uint8))
    folder = VolumeFolder(tmp_path)
    np.testing.assert_array_equal(folder.seconds, [99.25, 200.0, 1000.5])
    assert [volume[0, 0, 0] for volume in folder] == [99, 200, 1000 % 256]
    assert [volume[0, 0, 0] for volume in folder[1::2]] == [200]
    np.testing.assert_array_equal(folder.labels(), [np.arange(6)] * 3)


def test_folders_without_volumes_are_refused(tmp_path):
    with pytest.raises(BadInput, match="has no volumes"):
        VolumeFolder(tmp_path)
    with pytest.raises(BadInput, match="is not a folder"):
        VolumeFolder(tmp_path / "none")
    write(tmp_path, "last.npz")
    with pytest.raises(BadInput, match="the name is not a time stamp"):
        VolumeFolder(tmp_path)


@pytest.mark.parametrize(
    ("arrays", "problem"),
    [
        ({"data": VOLUME.astype(np.float32)}, "data: expected uint8"),
        ({"data": VOLUME[0]}, "data: expected uint8"),
        ({"data": VOLUME[:2]}, "data: expected uint8"),
        ({"data": np.array([object()])}, "is not a readable"),
        ({"pos": np.arange(5.0)}, "pos: expected six finite numbers"),
        ({"pos": np.full(6, np.nan)}, "pos: expected six finite numbers"),
        ({"pos": np.array(list("abcdef"))}, "pos: expected six finite numbers"),
    ],
)
def test_wrong_arrays_are_refused_with_the_name_of_the_file(tmp_path, arrays, problem):
    write(tmp_path, "1.0.npz", **arrays)
    folder = VolumeFolder(tmp_path)
    with pytest.raises(BadInput, match=problem) as refused:
        folder[0], folder.labels()
    assert "1.0.npz" in str(refused.value)


def test_other_shapes_and_damaged_files_are_refused(tmp_path):
    write(tmp_path, "1.npz")
    write(tmp_path, "2.npz", data=VOLUME[:, :, :3])
    folder = VolumeFolder(tmp_path)
    assert folder[0].shape == (16, 3, 4)
    with pytest.raises(BadInput, match=r"as in other files; found \(16, 3, 3\)"):
        folder[1]
    bytes_ = (tmp_path / "2.npz").read_bytes()
    for damaged in (b"", bytes_[:100], bytes_[:-40], bytes_.replace(bytes(60), bytes(59) + b"x", 1)):
        (tmp_path / "2.npz").write_bytes(damaged)
        with pytest.raises(BadInput, match=r"2\.npz: is not a readable \.npz file"):
            VolumeFolder(tmp_path)[1]
    np.savez(tmp_path / "2.npz", other=VOLUME)
    with pytest.raises(BadInput, match="has no array 'data'"):
        VolumeFolder(tmp_path)[1]
