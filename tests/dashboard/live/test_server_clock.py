"""What a page knows of the server's clock, in the browser."""

import pytest

SERVER_AHEAD_MS, NOW_MS = 1000.0, 5000.0
PROMPT, SLOW_THERE, SLOW_BACK, BUSY_PAGE = (1, 1), (90, 2), (2, 90), (200, 310)


@pytest.fixture
def concluded(live, open_page):
    """What a page concludes from pings that take some time there and back [ms]."""
    page = open_page(live.url)
    program = """async ([pings, ahead_ms, now_ms]) => {
        const { ServerClock } = await import("/static/common/clock.js"), clock = new ServerClock();
        for (const [there_ms, back_ms] of pings) clock.addPing(0, ahead_ms + there_ms, there_ms + back_ms);
        return [now_ms - clock.page_ms(ahead_ms + now_ms), clock.stamp_ms(now_ms), clock.now_ms(now_ms)];
    }"""
    return lambda *pings: page.evaluate(program, [pings, SERVER_AHEAD_MS, NOW_MS])


@pytest.mark.parametrize(
    "pings",
    [
        [PROMPT],
        [SLOW_THERE],
        [SLOW_BACK],
        [BUSY_PAGE],
        [BUSY_PAGE, SLOW_THERE, SLOW_BACK],
        [SLOW_BACK, *[PROMPT] * 30],
    ],
)
def test_neither_an_image_nor_a_motion_seems_younger_than_it_is(concluded, pings):
    age_ms, stamp_ms, now_ms = concluded(*pings)
    assert age_ms == min(there_ms for there_ms, _ in pings)
    assert stamp_ms == NOW_MS + SERVER_AHEAD_MS - min(back_ms for _, back_ms in pings)
    assert stamp_ms <= now_ms <= NOW_MS + SERVER_AHEAD_MS + age_ms


def test_before_the_first_ping_nothing_is_known(concluded):
    assert concluded() == [pytest.approx(float("nan"), nan_ok=True)] * 3
