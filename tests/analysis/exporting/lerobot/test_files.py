import numpy as np
import pytest

from haptigraph.analysis.exporting.lerobot.files import DataFiles, Place, VideoFiles, encoding, write_tasks

pa = pytest.importorskip("pyarrow")
av = pytest.importorskip("av")


def test_a_thousand_files_fill_a_folder(tmp_path):
    assert Place.of(999) == (0, 999)
    assert Place.of(1000) == (1, 0)
    assert Place.of(2003).path(tmp_path, ".mp4") == tmp_path / "chunk-002" / "file-003.mp4"


def test_pandas_reads_tasks_with_the_task_as_the_index(tmp_path):
    pandas = pytest.importorskip("pandas")
    write_tasks(tmp_path / "tasks.parquet", ["peel", "inject"])
    frame = pandas.read_parquet(tmp_path / "tasks.parquet")
    assert list(frame.index) == ["peel", "inject"]
    assert frame.loc["inject"].task_index == 1
    assert list(frame.columns) == ["task_index"]


def test_small_tables_share_a_file(tmp_path):
    from pyarrow import parquet

    files = DataFiles(tmp_path)
    places = [files.write(pa.table({"a": [number]})) for number in range(3)]
    files.close()
    assert set(places) == {(0, 0)}
    assert parquet.read_table(places[0].path(tmp_path, ".parquet"))["a"].to_pylist() == [0, 1, 2]


@pytest.mark.parametrize("shape", [(31, 47, 3), (32, 48, 3)])
@pytest.mark.parametrize("is_lossless", [True, False])
def test_pictures_of_any_size_come_back_at_their_times(shape, is_lossless, tmp_path):
    fps = 30
    files = VideoFiles(tmp_path, shape, fps, encoding(shape, is_lossless=is_lossless, fps=fps))
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    pictures = [
        np.stack([rows * 4 + 3 * i, columns * 4, rows + columns], -1).astype(np.uint8) for i in range(5)
    ]
    assert files.begin_episode() == (Place(0, 0), 0)
    for picture in pictures:
        files.add(picture)
    assert files.begin_episode() == (Place(0, 0), 5 / fps)
    files.close()
    with av.open(str(tmp_path / "chunk-000" / "file-000.mp4")) as container:
        frames = list(container.decode(video=0))
    assert [frame.time for frame in frames] == pytest.approx([number / fps for number in range(5)], abs=1e-9)
    for frame, picture in zip(frames, pictures, strict=True):
        found = frame.to_ndarray(format="rgb24")
        assert found.shape == shape
        apart = np.abs(found.astype(int) - picture)
        assert apart.max() == 0 if is_lossless else apart.mean() < 6
