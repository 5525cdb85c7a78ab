"""An archive of thousands of recordings: index, queries, and batches in processes and on a Dask cluster.

`python benchmarks/archive.py WHAT...` measures: overhead, index, queries, one, two, dask, killed (default:
all), or `simulated` for queries over 10^5 recordings that are drawn at random. The recordings are those of
`--folder`, as `archive_recordings.py` makes them; without it, new ones. Other load on the machine distorts
wall times, so CPU times are printed, and the load.
"""

import argparse
import hashlib
import itertools
import os
import random
import resource
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from multiprocessing import active_children
from pathlib import Path

import msgspec
from archive_recordings import make_recordings

from haptigraph.analysis.archive.index import update_archive
from haptigraph.analysis.archive.query import query_archive
from haptigraph.analysis.batch.batch import Batch, open_results, run_batch
from haptigraph.analysis.batch.tasks import BatchTask
from haptigraph.analysis.batch.work import do_task
from haptigraph.analysis.metrics.replay import replay_pipeline
from haptigraph.assemble import load_procedure
from haptigraph.recording.reader import RunReader
from haptigraph.spreading.tasks import Cluster

OTHER = "subretinal_injection_steady"
QUERIES = {
    "outcomes of each procedure": """
        SELECT procedure, count(*), avg((outcome = 'hit')::int), avg(completion_s), avg(mean_theta_deg)
        FROM runs WHERE problem = '' GROUP BY procedure ORDER BY procedure""",
    "August, theta above 5° within 3 mm of the retina": """
        SELECT recording, min(step) FROM runs JOIN steps USING (recording)
        WHERE month(started_utc) = 8 AND theta_deg > 5 AND distance_to_retina_mm < 3
        GROUP BY recording ORDER BY recording""",
    "time in each state": """
        SELECT state, sum(seconds) FROM (
            SELECT unnest(map_keys(state_s)) AS state, unnest(map_values(state_s)) AS seconds FROM runs
        ) GROUP BY state ORDER BY state""",
}
OVERHEAD_RECORDINGS = 40
REPEATS = 2
KILL_EVERY_S = 10


def main() -> None:
    """Measure what was asked for."""
    measures: dict[str, Callable[[Path], None]] = {
        "overhead": overhead,
        "index": index,
        "queries": queries,
        "one": lambda folder: batch(folder, "one", 1),
        "two": lambda folder: batch(folder, "two", 2),
        "killed": lambda folder: batch(folder, "killed", 2, kills=True),
        "dask": dask_cluster,
    }
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="a folder of recordings")
    parser.add_argument("--count", type=int, default=2000, help="recordings to make without --folder")
    parser.add_argument("what", nargs="*", choices=[*measures, "simulated"], default=list(measures))
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = given.folder or Path(place) / "recordings"
        if given.folder is None:
            make_recordings(folder, given.count)
        for name in given.what:
            print(f"== {name}, load {os.getloadavg()[0]:.1f}", flush=True)
            (simulated if name == "simulated" else measures[name])(folder)


def overhead(folder: Path) -> None:
    """CPU time of a batch's replay beside the pipeline alone, alternately."""
    other, recordings = load_procedure(OTHER), list[Path]()
    for path in sorted(folder.rglob("*.mcap")):
        task = BatchTask("replay", str(folder), path.relative_to(folder).as_posix(), 0, 0)
        if len(recordings) < OVERHEAD_RECORDINGS and not do_task(task).problem:
            recordings.append(path)

    def alone(path: Path) -> None:
        reader = RunReader(path)
        pipeline = replay_pipeline(reader, other)
        for capture, _ in reader.records():
            pipeline.step(capture)

    def batched(path: Path) -> None:
        do_task(
            BatchTask("replay", str(folder), path.relative_to(folder).as_posix(), 0, 0, other.text, OTHER)
        )

    cpu_s = {alone: 0.0, batched: 0.0}
    for path, work in itertools.product(recordings * REPEATS, (alone, batched)):
        start_s = time.process_time()
        work(path)
        cpu_s[work] += time.process_time() - start_s
    minutes = REPEATS * sum(length_s(path) for path in recordings) / 60
    share = 100 * (cpu_s[batched] / cpu_s[alone] - 1)
    print(
        f"CPU seconds per recorded minute: pipeline alone {cpu_s[alone] / minutes:.2f}, "
        f"batch {cpu_s[batched] / minutes:.2f}, overhead {share:.0f} %"
    )


def length_s(path: Path) -> float:
    """Return the length of a recording."""
    stamps = [step.stamp_ns for _, step in RunReader(path).records(images=())]
    return (stamps[-1] - stamps[0]) / 1e9


def index(folder: Path) -> None:
    """Index from scratch, then again, then after changes."""
    shutil.rmtree(folder / "archive", ignore_errors=True)
    with measured("from scratch, one worker"):
        print(summary(update_archive(folder)))
    with measured("again, unchanged"):
        print(summary(update_archive(folder)))
    for path in sorted(folder.rglob("*.mcap"))[:10]:
        path.touch()
    with measured("after 10 recordings have changed"):
        print(summary(update_archive(folder)))
    size_mb = sum(file.stat().st_size for file in (folder / "archive").iterdir()) / 1e6
    print(f"size of the archive: {size_mb:.1f} MB")


def summary(updated: object) -> str:
    """Return what an update did, without the list of damaged recordings."""
    content = msgspec.to_builtins(updated)
    return ", ".join(f"{key} {len(v) if isinstance(v, list) else v}" for key, v in content.items())


def queries(folder: Path) -> None:
    """Three queries."""
    for name, sql in QUERIES.items():
        with measured(name):
            print(f"{len(query_archive(folder, sql).rows)} rows")


def batch(folder: Path, name: str, workers: int, *, kills: bool = False, cluster: str = "") -> None:
    """Replay everything with another procedure."""
    output = folder.parent / f"{folder.name}-{name}"
    shutil.rmtree(output, ignore_errors=True)
    given = Batch("replay", folder, output, OTHER)
    memory, done = Memory(), threading.Event()
    killer = threading.Thread(target=kill_workers, args=(done,), daemon=True)
    if kills:
        killer.start()
    with measured(f"batch replay, {name}"):
        ran = run_batch(
            given, workers=workers, cluster=Cluster(cluster) if cluster else None, progress=memory.sample
        )
        done.set()
    with closing(open_results(given)) as results:
        rows = list(results.rows())
    digest = hashlib.sha256(msgspec.json.encode([row[:3] for row in rows])).hexdigest()[:16]
    passed_over = sum(bool(row.problem) for row in rows)
    print(f"{ran.now} done now, {len(rows)} results, {passed_over} passed over, results {digest}")
    print(f"CPU of the tasks {sum(row.cpu_s for row in rows):.0f} s; {memory.text()}", flush=True)


def kill_workers(done: threading.Event) -> None:
    """Kill one worker now and then."""
    killed = 0
    while not done.wait(KILL_EVERY_S):
        worker = random.choice(active_children())
        if worker.pid:
            os.kill(worker.pid, signal.SIGKILL)
            killed += 1
    print(f"{killed} workers were killed")


def dask_cluster(folder: Path) -> None:
    """On a local Dask cluster with two workers."""
    import dask
    from distributed import LocalCluster

    settings = {
        "n_workers": 2,
        "threads_per_worker": 1,
        "dashboard_address": "127.0.0.1:0",
        "silence_logs": 50,
    }
    with (
        dask.config.set({"distributed.worker.profile.enabled": False}),
        LocalCluster(**settings) as cluster,
    ):
        batch(folder, "dask", 2, cluster=cluster.scheduler_address)


class Memory:
    """Memory of this program and of its largest worker, at shares of the work."""

    def __init__(self) -> None:
        self._at: dict[int, tuple[int, int]] = {}

    def sample(self, what: str, done: int, total: int) -> None:
        """Sample at every fifth of the work."""
        fifth = 5 * done // max(total, 1)
        if fifth not in self._at and done:
            workers = [resident_mb(child.pid or 0) for child in active_children()]
            self._at[fifth] = resident_mb(os.getpid()), max(workers, default=0)

    def text(self) -> str:
        """Return the samples."""
        samples = [f"{20 * fifth} %: {own}+{worker} MB" for fifth, (own, worker) in self._at.items()]
        return f"memory of the program + of its largest worker: {', '.join(samples)}"


def resident_mb(process: int) -> int:
    """Return the resident memory of a process; 0 if it has ended."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0
    return pages * resource.getpagesize() // 1_000_000


@contextmanager
def measured(name: str) -> Iterator[None]:
    """Print wall and CPU time, that of ended processes included."""

    def cpu_s() -> float:
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        return time.process_time() + children.ru_utime + children.ru_stime

    start_s, start_cpu_s = time.perf_counter(), cpu_s()
    yield
    wall_s, used_s = time.perf_counter() - start_s, cpu_s() - start_cpu_s
    print(f"{name}: wall {wall_s:.2f} s, CPU {used_s:.2f} s, load {os.getloadavg()[0]:.1f}", flush=True)


def simulated(folder: Path, count: int = 100_000, steps: int = 60) -> None:
    """Queries over an archive of random recordings; only its index is real."""
    import numpy as np
    import pyarrow as pa

    from haptigraph.analysis.archive.tables import Archive, no_runs, with_rows

    chance, names = np.random.default_rng(1), [f"P{n // 40:04}/run-{n:06}.mcap" for n in range(count)]
    with tempfile.TemporaryDirectory() as place:
        archive = Archive(Path(place))
        archive.place.mkdir()
        runs = no_runs()
        for start in range(0, count, 10_000):
            part_names, rows = names[start : start + 10_000], 10_000 * steps
            table = pa.table(
                {
                    "recording": pa.array(np.repeat(part_names, steps)),
                    "step": np.tile(np.arange(steps), len(part_names)),
                    "time_s": np.tile(np.arange(steps) / 30, len(part_names)),
                    "theta_deg": chance.gamma(2, 1.0, rows),
                    "distance_to_retina_mm": chance.uniform(0, 20, rows),
                }
            )
            part = archive.write_part([table])
            drawn = [_row(name, part, at, chance.random()) for at, name in enumerate(part_names, start)]
            runs = with_rows(runs, drawn)
        archive.write_runs(runs)
        size_mb = sum(file.stat().st_size for file in archive.place.iterdir()) / 1e6
        print(f"{count} recordings, {count * steps} steps, {size_mb:.0f} MB")
        queries(Path(place))
        print(f"memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000} MB at most")


def _row(name: str, part: str, number: int, chance: float) -> dict[str, object]:
    return {
        "recording": name,
        "part": part,
        "started_utc": f"2026-{1 + number % 12:02}-01T08:00:00+00:00",
        "procedure": f"procedure_{number % 4}",
        "outcome": "hit" if chance < 0.8 else "no hit",
        "completion_s": 10 * chance,
        "mean_theta_deg": 5 * chance,
        "state_s": {"aligned_retinal_approach": chance, "target_hit": 1 - chance},
    }


if __name__ == "__main__":
    main()
