"""Figures of the live page: latency through a real browser, load on the server, memory of a page left open.

    python benchmarks/live.py latency   input -> displayed image, image -> rumble call (or one: input, rumble)
    python benchmarks/live.py load      server CPU and the loop's p99, without and with two viewers
    python benchmarks/live.py memory    the page's heap over as many images as an hour has

Needs Chromium and Linux. Run it on a quiet machine; the figures are of all that runs on it, browser included.
"""

import json
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2

from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from live_bench import PAD, Live, chromium, leave, look, until

PRESSES = 100
TURNS, TURNS_S = 60, 0.5
LOAD_S = 12
ROUNDS = 4
HOUR = 30 * 3600
FAST_HZ = 45
MISSED = 3  # times as many images are there: the page misses some

KEYS = """async () => {
  const { page } = await import('/static/live.js');
  window.waits = [];
  let pressed = null;
  addEventListener('keydown', (event) => { if (!event.repeat) pressed = event.timeStamp; }, true);
  page.onDrawn = (header) => {
    if (pressed === null || !header.hand?.engaged) return;
    window.waits.push(performance.now() - pressed);
    pressed = null;
  };
}"""
"""Note how long it takes from a key to the first drawn image in which the key moves the needle."""

CHANGES = """async () => {
  const { page } = await import('/static/live.js');
  window.waits = { on: [], off: [] };
  let plays = page.header.plays, calls = window.rumble.length;
  page.onImage = (header) => {
    if (header.plays === plays) return;
    plays = header.plays;
    const [list, wanted] = plays === 'off' ? [window.waits.off, 'reset'] : [window.waits.on, 'dual-rumble'];
    const at = performance.timeOrigin + page.clock.page_ms(header.time_ms);
    setTimeout(() => {  // the touch may come before or after the image that caused it
      const call = window.rumble.slice(calls).find((each) => each.type === wanted && each.at > at);
      if (call) list.push(call.at - at);
      calls = window.rumble.length;
    }, 250);
  };
}"""
"""Note how long it takes from the capture of an image that changes what is felt to the rumble call."""

WATCHER = """
import json, sys
from websockets.sync.client import connect
host = sys.argv[1]
with connect(f"ws://{host}/live", origin=f"http://{host}") as line:
    while True:
        message = line.recv()
        if isinstance(message, bytes):
            header = json.loads(message[4:4 + int.from_bytes(message[:4], "big")])
            line.send(json.dumps({"type": "ack", "number": header["number"]}))
"""


def percentiles(values: list[float]) -> str:
    """Say how values [ms] are spread."""
    ordered = sorted(values)
    return (
        f"p50 {statistics.median(ordered):5.0f} ms   p99 {ordered[int(0.99 * (len(ordered) - 1))]:5.0f} ms   "
        f"most {ordered[-1]:5.0f} ms   n {len(ordered)}"
    )


def opened(browser: Any, live: Live) -> Any:
    """Open the live page with a test controller, and let it settle."""
    context = browser.new_context(viewport={"width": 1366, "height": 768})
    context.add_init_script(PAD)
    page = context.new_page()
    page.problems = []
    page.goto(live.url)
    until(page, "document.body.dataset.index > 60")
    return page


def rate_hz(page: Any) -> float:
    """Return how many images a second the page draws."""
    first, begun_s = look(page, "page.drawn"), time.perf_counter()
    time.sleep(5)
    return float((look(page, "page.drawn") - first) / (time.perf_counter() - begun_s))


def input_to_image(browser: Any) -> None:
    """From a key's event to the first drawn image of a needle that the key moves."""
    with Live("teleop:align_then_approach") as live:
        page = opened(browser, live)
        until(page, "document.getElementById('holder').textContent.startsWith('You')")
        page.evaluate(KEYS)
        for number in range(PRESSES):
            key = ("ArrowDown", "ArrowUp")[number % 2]
            page.keyboard.down(key)
            until(page, f"window.waits.length > {number}")
            page.keyboard.up(key)
            until(page, "!page.header.hand.engaged")
        print(f"input -> displayed image   {percentiles(page.evaluate('window.waits'))}")
        print(f"                           drawn {rate_hz(page):.1f} images/s")
        leave(page)


def image_to_rumble(browser: Any, folder: Path) -> None:
    """From the capture of the image that changes the state to the page's rumble call."""
    turns = folder / "turns.toml"
    moves = "\n".join(
        f"[[move]]\nduration_s = {duration_s}\ndepth_mm = 12.0\ntheta_deg = {theta_deg}\n"
        for theta_deg in (0.0, -5.0)
        for duration_s in (0.05, TURNS_S)
    )
    turns.write_text(
        f'[scenario]\ndescription = "Aligned, misaligned, repeated."\n[appearance]\nstyle = "dark"\n{moves}'
    )
    with Live(f"phantom:{turns}") as live:
        page = opened(browser, live)
        page.evaluate(CHANGES)
        until(page, f"Math.min(window.waits.on.length, window.waits.off.length) >= {TURNS}", 300)
        waits = page.evaluate("window.waits")
        print(f"image -> rumble begins     {percentiles(waits['on'])}")
        print(f"image -> rumble ends       {percentiles(waits['off'])}")
        print(f"                           drawn {rate_hz(page):.1f} images/s")
        leave(page)


def cpu_s(pid: int) -> float:
    """Return the processor time a process has used [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def loaded(viewers: int) -> tuple[float, float, float]:
    """Return CPU [share of a core], and the loop's p50 and p99 [ms], with so many viewers."""
    with Live("phantom:align_then_approach") as live:
        host = live.url.removeprefix("http://").strip("/")
        watchers = [
            subprocess.Popen([sys.executable, "-c", WATCHER, host], stderr=subprocess.DEVNULL)
            for _ in range(viewers)
        ]
        time.sleep(2)
        before_s, begun_s = cpu_s(live.process.pid), time.perf_counter()
        time.sleep(LOAD_S)
        share = (cpu_s(live.process.pid) - before_s) / (time.perf_counter() - begun_s)
        told = live.stop()
        for watcher in watchers:
            watcher.terminate()
            watcher.wait()
    step = re.search(r"^step +([\d.]+) ms +([\d.]+) ms", told, re.MULTILINE)
    if step is None:
        raise RuntimeError(told)
    return share, float(step[1]), float(step[2])


def load() -> None:
    """Compare a server that nobody watches with one that two viewers watch."""
    print(f"{'viewers':10}{'CPU':>8}{'step p50':>12}{'step p99':>12}   (rounds of {LOAD_S} s, in turn)")
    rows: dict[int, list[tuple[float, float, float]]] = {0: [], 2: []}
    for _ in range(ROUNDS):
        for viewers, results in rows.items():
            results.append(loaded(viewers))
    for viewers, results in rows.items():
        share, p50_ms, p99_ms = (statistics.median(column) for column in zip(*results, strict=True))
        told = ", ".join(f"{result[2]:.1f}" for result in results)
        print(f"{viewers:<10}{share:8.0%}{p50_ms:9.2f} ms{p99_ms:9.2f} ms   p99 of each: {told}")


def memory(browser: Any, folder: Path, images: int) -> None:
    """Let the page draw as many images as an hour has, faster than in an hour; small ones, read from files.

    Tells the heap of its scripts after collecting garbage, and the private memory of its process: pictures
    that are decoded lie outside the heap.
    """
    source = shots(folder, (1 + MISSED) * (images + FAST_HZ * 60))
    given = ("--registration", folder / "registration.toml", "--set", f"source.rate_hz={FAST_HZ}")
    with Live(source, *given) as live:
        page = opened(browser, live)
        session = page.context.new_cdp_session(page)
        process = f"/proc/{renderer(browser)}/smaps_rollup"

        def used_mb() -> tuple[float, float]:
            session.send("HeapProfiler.collectGarbage")
            heap_mb = float(session.send("Runtime.getHeapUsage")["usedSize"] / 1e6)
            own = re.findall(r"^Private_\w+: +(\d+) kB", Path(process).read_text(), re.MULTILINE)
            return heap_mb, sum(map(int, own)) * 1.024e-3

        begun_s, begun = time.perf_counter(), look(page, "page.drawn")
        first: tuple[float, float] | None = None
        for share in (1 / 60, *(number / 20 for number in range(1, 21))):
            until(page, f"page.ended || page.drawn >= {begun + share * images}", 7200)
            if look(page, "page.ended"):
                raise RuntimeError("too few images: the page missed most")
            heap_mb, process_mb = used_mb()
            first = first or (heap_mb, process_mb)
            drawn, passed_s = look(page, "page.drawn") - begun, time.perf_counter() - begun_s
            told = f"heap {heap_mb:5.2f} MB, process {process_mb:6.1f} MB"
            print(f"{drawn:7d} images drawn in {passed_s:5.0f} s: {told}", flush=True)
        grown = f"heap {heap_mb - first[0]:+.2f} MB, process {process_mb - first[1]:+.1f} MB"
        print(f"over the first minute's end: {grown}")
        leave(page)


def shots(folder: Path, images: int) -> Path:
    """Write images of a scenario and its registration; return a folder where they stand again and again."""
    phantom = Phantom(load_scenario(str(Path(__file__).parents[1] / "tests" / "data" / "quick.toml")))
    (folder / "registration.toml").write_text(phantom.registration)
    taken: list[Path] = []
    while (moment := phantom.advance()) is not None:
        taken.append(folder / f"{len(taken)}.jpg")
        cv2.imwrite(str(taken[-1]), moment.image, [cv2.IMWRITE_JPEG_QUALITY, 90])
    again = folder / "again"
    again.mkdir()
    for number in range(images):
        (again / f"{number:06}.jpg").symlink_to(taken[number % len(taken)])
    return again


def renderer(browser: Any) -> int:
    """Return the number of the process that holds the only page."""
    processes = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    return int(
        max((each for each in processes if each["type"] == "renderer"), key=lambda each: each["cpuTime"])[
            "id"
        ]
    )


def main() -> None:
    """Measure what was asked for."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that server and browser end too
    what = sys.argv[1] if len(sys.argv) > 1 else "latency"
    print(json.dumps({"machine": f"{os.cpu_count()} cores", "load": os.getloadavg()}))
    with tempfile.TemporaryDirectory() as folder:
        if what == "load":
            load()
            return
        with chromium() as browser:
            if what == "memory":
                memory(browser, Path(folder), int(sys.argv[2]) if len(sys.argv) > 2 else HOUR)
            if what in ("latency", "input"):
                input_to_image(browser)
            if what in ("latency", "rumble"):
                image_to_rumble(browser, Path(folder))


if __name__ == "__main__":
    main()
