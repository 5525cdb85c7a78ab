import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.by_time import ByTime

TIMES_S = st.lists(st.floats(0, 100), min_size=1, max_size=30).map(lambda times: [0.0, *sorted(times)])


@given(TIMES_S, st.floats(0, 100))
def test_an_item_is_current_from_its_time_until_the_next(time_s, at_s):
    items = ByTime(range(len(time_s)), time_s)
    if at_s > time_s[-1]:
        with pytest.raises(IndexError, match=r"nothing at .* s; valid: 0 to "):
            _ = items[at_s]
    else:
        number = items[at_s]
        assert time_s[number] <= at_s
        assert number + 1 == len(time_s) or time_s[number + 1] > at_s


@given(TIMES_S, st.none() | st.floats(-5, 105), st.none() | st.floats(-5, 105))
def test_a_slice_has_the_items_from_its_start_up_to_its_end(time_s, start_s, end_s):
    wanted = [
        number
        for number, at_s in enumerate(time_s)
        if (start_s is None or at_s >= start_s) and (end_s is None or at_s < end_s)
    ]
    assert list(ByTime(range(len(time_s)), time_s)[start_s:end_s]) == wanted


def test_a_slice_of_time_has_no_step_and_nothing_is_at_any_time_of_no_run():
    with pytest.raises(ValueError, match="a slice of time has no step, found 2"):
        _ = ByTime([1], [0.0])[::2]
    with pytest.raises(IndexError, match="nothing at 0 s; valid: none"):
        _ = ByTime([], [])[0.0]
    assert ByTime([], [])[:] == []
    assert repr(ByTime([1, 2], [0.0, 0.5])) == "<ByTime of 2 items, 0 to 0.500 s>"
