"""A fresh page for each test, in the browser of all."""

import re
import time
from pathlib import Path

import pytest
from helpers import scenario_at
from live_bench import LIVE, PAD, PHONE, Live, until
from real_run import LatencyProbe

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.recording import writer


@pytest.fixture
def open_page(chromium):
    """Open pages, each in a context of its own; the test fails if one logs an error or requests another host."""
    contexts, problems = [], []

    def open_one(
        url: str,
        *,
        pad: bool = False,
        phone: bool = False,
        size: tuple[int, int] = (1366, 768),
        module: str = LIVE,
        ready: str = "document.body.dataset.index > 0",
    ):
        context = chromium.new_context(viewport={"width": size[0], "height": size[1]}, has_touch=phone)
        contexts.append(context)
        for script in [PAD] * pad + [PHONE] * phone:
            context.add_init_script(script)
        page = context.new_page()
        page.set_default_timeout(30_000)
        page.problems, page.module, page.is_left = problems, module, False
        page.on(
            "console", lambda message: problems.append(message.text) if _is_error(message, page) else None
        )
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("request", lambda request: problems.append(request.url) if _is_foreign(request.url) else None)
        page.goto(url)
        until(page, ready, module=module)
        return page

    def close_all() -> None:
        while contexts:
            contexts.pop().close()

    open_one.close_all = close_all
    yield open_one
    close_all()
    assert problems == []


@pytest.fixture
def late_ms():
    """Return the scheduling latency that other work has added to a thread since a time [ms since 1970]."""
    probe = LatencyProbe()

    def since(event_ms: float) -> float:
        now_ns = time.monotonic_ns()
        return probe.late_ms(now_ns - (time.time_ns() - round(event_ms * 1e6)), now_ns)

    yield since
    probe.is_stopped.set()


def _is_error(message, page) -> bool:
    """Whether it is an error, and not one that arrives once its page is being closed."""
    return message.type == "error" and not (page.is_left or page.is_closed())


def _is_foreign(url: str) -> bool:
    return not re.match(r"(https?|ws)://127\.0\.0\.1[:/]|(blob|data|about):", url)


@pytest.fixture(scope="module")
def live(quick_uri):
    """One server that repeats a short scenario, for tests that only watch."""
    with Live(quick_uri) as running:
        yield running


@pytest.fixture(scope="session")
def recordings(quick_uri, procedure, tmp_path_factory) -> Path:
    """A read-only folder of recordings, valid and invalid, and another procedure."""
    folder = tmp_path_factory.mktemp("recordings")
    settings = (f"source.uri={quick_uri}", "run.realtime=false", "trial.participant=P07", "trial.trial=3")
    (folder / "p08").mkdir()
    for name, before_compaction in (("quick", False), ("killed", True), ("p08/again", False)):
        with pytest.MonkeyPatch.context() as patch:
            if before_compaction:
                patch.setattr(writer, "compact", lambda *arguments, **options: 0)
            assemble.build(load_config(None, (*settings, f'recording.path="{folder / name}.mcap"'))).run()
    data = (folder / "killed.mcap").read_bytes()
    (folder / "killed.mcap").write_bytes(data[: len(data) * 2 // 3])
    damaged = bytearray((folder / "quick.mcap").read_bytes())
    damaged[len(damaged) // 2 : len(damaged) // 2 + 40] = bytes(40)
    (folder / "damaged.mcap").write_bytes(damaged)
    (folder / "notes.mcap").write_text("Remember the milk.")
    outside = tmp_path_factory.mktemp("elsewhere") / "secret.mcap"
    outside.write_bytes((folder / "quick.mcap").read_bytes())
    (folder / "link.mcap").symlink_to(outside)
    (folder / "wide.toml").write_text(procedure.text.replace("= 1.7", "= 4.0"))
    return folder


@pytest.fixture(scope="session")
def calm_uri(quick, tmp_path_factory) -> str:
    """A scenario of one image a second, for servers of whose loop nothing is asked."""
    return f"phantom:{scenario_at(1, quick, tmp_path_factory.mktemp('calm'))}"


@pytest.fixture(scope="module")
def archive(calm_uri, recordings):
    """One server of that folder, for tests that only read."""
    with Live(calm_uri, "--recordings", recordings) as running:
        yield running
