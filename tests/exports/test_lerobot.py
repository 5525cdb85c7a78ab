"""LeRobot's own library opens an exported dataset; every feature is that of the recording."""

import cv2
import numpy as np
import pytest

from haptigraph.analysis.exporting.columns import RunTable
from haptigraph.analysis.exporting.lerobot.features import IMAGE, VECTORS
from haptigraph.analysis.exporting.runs import export_runs

pytest.importorskip("pyarrow")
pytest.importorskip("av")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]
LEAST_PSNR_DB = 35


@pytest.fixture(scope="module", params=["lerobot-3.11", "lerobot-3.12"])
def environment(request):
    return request.param


@pytest.fixture(scope="module", params=[True, False], ids=["lossless", "small"])
def is_lossless(request):
    return request.param


@pytest.fixture(scope="module")
def found(read_in, environment, is_lossless, recordings, tmp_path_factory):
    """What LeRobot returns, by name."""
    folder = tmp_path_factory.mktemp("lerobot")
    export_runs(recordings, "lerobot", folder / "dataset", is_lossless=is_lossless)
    read_in(environment, "read_lerobot.py", folder / "dataset", folder / "found.npz")
    with np.load(folder / "found.npz") as file:
        return dict(file)


@pytest.fixture(scope="module")
def tables(recordings):
    return [RunTable(path, "") for path in recordings]


@pytest.fixture(scope="module")
def rows(tables):
    return [[*table.rows(images=True)] for table in tables]


def test_every_number_and_text_is_that_of_the_recordings(found, tables, rows):
    columns = {column.name: column for column in tables[0].columns}
    every = [row for episode in rows for row in episode]
    assert found["surgical_state"].tolist() == [row.step.conclusion.state for row in every]
    assert found["haptics.pattern"].tolist() == [row.step.command.pattern.name for row in every]
    assert found["stamp_ns"].ravel().tolist() == [row.step.stamp_ns for row in every]
    seen = 0
    for name, groups in VECTORS.items():
        if name not in found:
            continue
        chosen = [
            column
            for column in columns.values()
            if column.group in groups
            and (column.kind == "number" or column.group == "truth")
            and any(column.value(row) is not None for row in every)
        ]
        values = [[column.value(row) for column in chosen] for row in every]
        expected = np.array(values, np.float64).astype(np.float32)  # None becomes NaN
        np.testing.assert_array_equal(found[name], expected, name)
        seen += len(chosen)
    assert seen > 20


def test_every_triplet_is_that_of_the_recordings(found, tables, rows):
    names = [f"<{', '.join(one.names)}>" for one in tables[0].procedure.schema.relations]
    triplets = found["scene_graph.triplets"]
    for row, held in zip([row for episode in rows for row in episode], triplets, strict=True):
        edges = {str(edge) for edge in row.step.graph.edges}
        assert {name for name, holds in zip(names, held, strict=True) if holds} == edges
    assert 0 < triplets.mean() < 1


def test_images_are_those_of_the_recordings(found, rows, is_lossless):
    every = [row.capture.image for episode in rows for row in episode]
    assert found["observation.has_image"].ravel().tolist() == [int(image is not None) for image in every]
    worst_db = np.inf
    for image, pixels in zip(every, found[IMAGE], strict=True):
        if image is None:
            assert pixels.max() <= (0 if is_lossless else 2)
            continue
        expected = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
        if is_lossless:
            assert np.array_equal(pixels, expected)
        worst_db = min(worst_db, cv2.PSNR(pixels, expected))
    assert worst_db >= LEAST_PSNR_DB


def test_episodes_counters_and_the_task_are_right(found, tables, rows):
    lengths = [len(episode) for episode in rows]
    assert found["episodes"].tolist() == [[0, lengths[0]], [lengths[0], sum(lengths)]]
    assert found["index"].ravel().tolist() == list(range(sum(lengths)))
    assert found["frame_index"].ravel().tolist() == [*range(lengths[0]), *range(lengths[1])]
    assert found["episode_index"].ravel().tolist() == [0] * lengths[0] + [1] * lengths[1]
    assert np.array_equal(found["timestamp"].ravel(), (found["frame_index"].ravel() / 15).astype(np.float32))
    assert set(found["task"].tolist()) == {tables[0].procedure.title}


def test_statistics_are_those_of_the_known_values(found):
    state = found["observation.state"].astype(np.float64)
    for name, of_state in (("mean", np.nanmean), ("std", np.nanstd), ("min", np.nanmin), ("max", np.nanmax)):
        np.testing.assert_allclose(
            found[f"stats/observation.state/{name}"], of_state(state, axis=0), rtol=1e-5, atol=1e-6
        )
    assert found[f"stats/{IMAGE}/mean"].shape == (3, 1, 1)
