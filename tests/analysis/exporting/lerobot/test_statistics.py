import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from haptigraph.analysis.exporting.lerobot.statistics import ImageStatistics, of_values, over_all

NUMBERS = st.one_of(st.floats(-1e3, 1e3, width=32), st.just(np.nan))
EPISODES = st.lists(
    st.integers(1, 6).flatmap(lambda length: arrays(np.float64, (length, 2), elements=NUMBERS)),
    min_size=1,
    max_size=4,
)


@given(EPISODES)
def test_statistics_over_all_episodes_are_those_of_all_known_values(episodes):
    found = over_all([of_values(values) for values in episodes])
    every = np.concatenate(episodes)
    assert found["count"] == [len(every)]
    for channel in range(2):
        known = every[~np.isnan(every[:, channel]), channel]
        if not len(known):
            assert np.isnan(found["mean"][channel])
            continue
        assert (found["min"][channel], found["max"][channel]) == (known.min(), known.max())
        np.testing.assert_allclose(found["mean"][channel], known.mean(), atol=1e-9)
        np.testing.assert_allclose(found["std"][channel], known.std(), atol=1e-6)
        assert known.min() <= found["q50"][channel] <= known.max()


@given(arrays(np.float64, (40, 1), elements=st.floats(-1e3, 1e3)))
def test_quantiles_of_an_episode_are_numpys(values):
    statistics, known = of_values(values)
    assert known == [40]
    assert statistics["q10"] == np.quantile(values, 0.1, axis=0)


def test_images_count_by_their_pixels_as_shares():
    images = ImageStatistics()
    images.add(np.full((8, 8, 3), (0, 51, 255), np.uint8))
    images.add(np.full((8, 8, 3), (0, 153, 255), np.uint8))
    statistics, known = images.result()
    assert statistics["mean"].shape == known.shape == (3, 1, 1)
    np.testing.assert_allclose(statistics["mean"].ravel(), [0, 0.4, 1])
    np.testing.assert_allclose(statistics["std"].ravel(), [0, 0.2, 0], atol=1e-12)
    np.testing.assert_allclose(statistics["q01"].ravel(), [0, 0.2, 1])
    assert statistics["count"] == [2]


def test_without_an_image_nothing_is_known():
    statistics, known = ImageStatistics().result()
    assert np.isnan(statistics["mean"]).all()
    assert not known.any()
