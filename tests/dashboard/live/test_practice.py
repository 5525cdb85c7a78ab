"""The score of a practice run on the live page."""

import pytest
from live_bench import Live, close_page, until

pytestmark = pytest.mark.browser


def test_the_page_shows_the_score_of_every_run(quick_uri, open_page, tmp_path):
    path = tmp_path / "scores.csv"
    with Live(quick_uri, "--practice", str(path)) as live:
        page = open_page(live.url)
        until(
            page, "/^Run [0-9]+: score .*best so far/.test(document.getElementById('score').textContent)", 60
        )
        assert page.is_visible("#score")
        close_page(page)
    assert len(path.read_text().splitlines()) >= 2
