import pytest
from live_bench import Live


@pytest.fixture(scope="module")
def live(calm_uri):
    """One server for tests that open other sources than that of its loop."""
    with Live(calm_uri) as running:
        yield running
