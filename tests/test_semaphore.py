from haptigraph.semaphore import InterruptSafeSemaphore


def test_there_are_so_many_places_and_no_more():
    room = InterruptSafeSemaphore(2)
    assert [room.take(0.0) for _ in range(3)] == [True, True, False]
    room.give_back()
    assert room.take(None)
    assert not room.take(0.001)
