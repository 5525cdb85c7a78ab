"""Benchmarks of the live page: latency through a real browser, load of viewers, memory of a page left open.

    python benchmarks/live.py latency   input -> displayed image, image -> rumble call (or one: input, rumble)
    python benchmarks/live.py load      server CPU and the loop's p99, without and with two viewers
    python benchmarks/live.py memory    heap of the page over the images of an hour

Needs Chromium and Linux. Run it on an idle machine: the results include the browser's load.
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
from live_bench import PAD, Live, chromium, close_page, evaluate, until

PRESSES = 100
TURNS, TURNS_S = 60, 0.5
LOAD_S = 12
ROUNDS = 4
HOUR = 30 * 3600
FAST_HZ = 45
SPARE = 3  # times as many images are provided, because the page misses some

KEYS = """async () => {
  const { page } = await import('/static/live/live.js');
  window.waits = [];
  let pressed = null;
  addEventListener('keydown', (event) => { if (!event.repeat) pressed = event.timeStamp; }, true);
  page.onDrawn = (header) => {
    if (pressed === null || !header.hand?.engaged) return;
    window.waits.push(performance.now() - pressed);
    pressed = null;
  };
}"""
"""Measure the time from a key to the first drawn image in which the key moves the needle."""

CHANGES = """async () => {
  const { page } = await import('/static/live/live.js');
  window.waits = { on: [], off: [] };
  let plays = page.header.plays, calls = window.rumble.length;
  page.onImage = (header) => {
    if (header.plays === plays) return;
    plays = header.plays;
    const [list, wanted] = plays === 'off' ? [window.waits.off, 'reset'] : [window.waits.on, 'dual-rumble'];
    const at = performance.timeOrigin + page.clock.page_ms(header.time_ms);
    setTimeout(() => {  // the haptic level may come before or after its image
      const call = window.rumble.slice(calls).find((each) => each.type === wanted && each.at > at);
      if (call) list.push(call.at - at);
      calls = window.rumble.length;
    }, 250);
  };
}"""
"""Measure the time from the capture of an image that changes the haptic output to the rumble call."""

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
    """Format the distribution of values [ms]."""
    ordered = sorted(values)
    return (
        f"p50 {statistics.median(ordered):5.0f} ms   p99 {ordered[int(0.99 * (len(ordered) - 1))]:5.0f} ms   "
        f"max {ordered[-1]:5.0f} ms   n {len(ordered)}"
    )


def open_page(browser: Any, live: Live) -> Any:
    """Open the live page with a test controller, and wait until it runs steadily."""
    context = browser.new_context(viewport={"width": 1366, "height": 768})
    context.add_init_script(PAD)
    page = context.new_page()
    page.problems = []
    page.goto(live.url)
    until(page, "document.body.dataset.index > 60")
    return page


def rate_hz(page: Any) -> float:
    """Return the images per second that the page draws."""
    first, started_s = evaluate(page, "page.drawn"), time.perf_counter()
    time.sleep(5)
    return float((evaluate(page, "page.drawn") - first) / (time.perf_counter() - started_s))


def input_to_image(browser: Any) -> None:
    """Measure from a key event to the first drawn image of a needle that the key moves."""
    with Live("teleop:align_then_approach") as live:
        page = open_page(browser, live)
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
        close_page(page)


def image_to_rumble(browser: Any, folder: Path) -> None:
    """Measure from the capture of an image that changes the state to the page's rumble call."""
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
        page = open_page(browser, live)
        page.evaluate(CHANGES)
        until(page, f"Math.min(window.waits.on.length, window.waits.off.length) >= {TURNS}", 300)
        waits = page.evaluate("window.waits")
        print(f"image -> rumble begins     {percentiles(waits['on'])}")
        print(f"image -> rumble ends       {percentiles(waits['off'])}")
        print(f"                           drawn {rate_hz(page):.1f} images/s")
        close_page(page)


def cpu_s(pid: int) -> float:
    """Return the processor time of a process [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def measure_load(viewers: int) -> tuple[float, float, float]:
    """Return CPU [share of a core] and the loop's p50 and p99 [ms] with a number of viewers."""
    with Live("phantom:align_then_approach") as live:
        host = live.url.removeprefix("http://").strip("/")
        watchers = [
            subprocess.Popen([sys.executable, "-c", WATCHER, host], stderr=subprocess.DEVNULL)
            for _ in range(viewers)
        ]
        time.sleep(2)
        before_s, started_s = cpu_s(live.process.pid), time.perf_counter()
        time.sleep(LOAD_S)
        share = (cpu_s(live.process.pid) - before_s) / (time.perf_counter() - started_s)
        output = live.stop()
        for watcher in watchers:
            watcher.terminate()
            watcher.wait()
    step = re.search(r"^step +([\d.]+) ms +([\d.]+) ms", output, re.MULTILINE)
    if step is None:
        raise RuntimeError(output)
    return share, float(step[1]), float(step[2])


def load() -> None:
    """Compare the server's load without viewers and with two."""
    print(f"{'viewers':10}{'CPU':>8}{'step p50':>12}{'step p99':>12}   (rounds of {LOAD_S} s, alternating)")
    rows: dict[int, list[tuple[float, float, float]]] = {0: [], 2: []}
    for _ in range(ROUNDS):
        for viewers, results in rows.items():
            results.append(measure_load(viewers))
    for viewers, results in rows.items():
        share, p50_ms, p99_ms = (statistics.median(column) for column in zip(*results, strict=True))
        p99s = ", ".join(f"{result[2]:.1f}" for result in results)
        print(f"{viewers:<10}{share:8.0%}{p50_ms:9.2f} ms{p99_ms:9.2f} ms   p99 of each: {p99s}")


def memory(browser: Any, folder: Path, images: int) -> None:
    """Let the page draw the images of an hour in less time; small ones, read from files.

    Prints the heap after garbage collection and the private memory of the page's process, because decoded
    images are not in the heap.
    """
    source = write_images(folder, (1 + SPARE) * (images + FAST_HZ * 60))
    given = ("--registration", folder / "registration.toml", "--set", f"source.rate_hz={FAST_HZ}")
    with Live(source, *given) as live:
        page = open_page(browser, live)
        session = page.context.new_cdp_session(page)
        process = f"/proc/{renderer(browser)}/smaps_rollup"

        def used_mb() -> tuple[float, float]:
            session.send("HeapProfiler.collectGarbage")
            heap_mb = float(session.send("Runtime.getHeapUsage")["usedSize"] / 1e6)
            own = re.findall(r"^Private_\w+: +(\d+) kB", Path(process).read_text(), re.MULTILINE)
            return heap_mb, sum(map(int, own)) * 1.024e-3

        started_s, drawn_before = time.perf_counter(), evaluate(page, "page.drawn")
        first: tuple[float, float] | None = None
        for share in (1 / 60, *(number / 20 for number in range(1, 21))):
            until(page, f"page.ended || page.drawn >= {drawn_before + share * images}", 7200)
            if evaluate(page, "page.ended"):
                raise RuntimeError("too few images: the page missed most of them")
            heap_mb, process_mb = used_mb()
            first = first or (heap_mb, process_mb)
            drawn, passed_s = evaluate(page, "page.drawn") - drawn_before, time.perf_counter() - started_s
            memory_mb = f"heap {heap_mb:5.2f} MB, process {process_mb:6.1f} MB"
            print(f"{drawn:7d} images drawn in {passed_s:5.0f} s: {memory_mb}", flush=True)
        growth = f"heap {heap_mb - first[0]:+.2f} MB, process {process_mb - first[1]:+.1f} MB"
        print(f"growth since the first minute: {growth}")
        close_page(page)


def write_images(folder: Path, images: int) -> Path:
    """Write images of a scenario and its registration; return a folder that links to them repeatedly."""
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
    """Return the process id of the only page's renderer."""
    processes = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    return int(
        max((each for each in processes if each["type"] == "renderer"), key=lambda each: each["cpuTime"])[
            "id"
        ]
    )


def main() -> None:
    """Run the benchmark that the command line names."""
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
