from haptigraph.semaphore import InterruptSafeSemaphore


def test_the_number_of_slots_is_limited():
    semaphore = InterruptSafeSemaphore(2)
    assert [semaphore.acquire(0.0) for _ in range(3)] == [True, True, False]
    semaphore.release()
    assert semaphore.acquire(None)
    assert not semaphore.acquire(0.001)
