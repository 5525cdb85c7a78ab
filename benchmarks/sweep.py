"""Speed of a sweep on a local Dask cluster with two workers and with one, and equality of the results.

`python benchmarks/sweep.py`. One worker and two alternately simulate blocks of participants, so that other
load affects both equally. The start of the clusters is excluded. On a busy machine the ratio is meaningless
(all workers together may get the share of one program), so the CPU time is printed as well.
"""

import argparse
import os
import tempfile
import time
from contextlib import ExitStack
from importlib import resources
from pathlib import Path

import dask
from distributed import Client, LocalCluster
from msgspec.structs import replace

from haptigraph.analysis.study_sweep.study_sweep import Sweep, run_sweep
from haptigraph.spreading.tasks import Cluster
from haptigraph.study.protocol import load_protocol

WORKERS = (1, 2)
NO_PROFILER = {"distributed.worker.profile.enabled": False}  # it takes a tenth of the time


def main() -> None:
    """Simulate, compare the results, and print the speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--participants", type=int, default=1000)
    parser.add_argument("--block", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--minutes", type=float, default=1e9, help="time limit; the current block is completed"
    )
    parser.add_argument("--folder", type=Path, help="a new folder for the results")
    given = parser.parse_args()
    paper = Path(str(resources.files("haptigraph.study"))) / "templates" / "study.toml"
    sweep = Sweep(load_protocol(paper), 0, given.seed)
    seconds, core_s, rows = dict.fromkeys(WORKERS, 0.0), dict.fromkeys(WORKERS, 0.0), {}
    print(f"{os.cpu_count()} cores, initial load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as place, ExitStack() as stack, dask.config.set(NO_PROFILER):
        folder = given.folder or Path(place)
        clusters = {
            count: stack.enter_context(
                LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address="127.0.0.1:0")
            )
            for count in WORKERS
        }
        for count, cluster in clusters.items():  # workers import modules on their first participant
            warm_up = replace(sweep, participants=2 * count, seed=given.seed + 1)
            run_sweep(warm_up, folder / f"warm {count}", cluster=Cluster(cluster.scheduler_address))
        for upto in range(given.block, given.participants + given.block, given.block):
            block = replace(sweep, participants=min(upto, given.participants))
            for count, cluster in clusters.items():
                start_s, start_core_s = time.perf_counter(), core_seconds(cluster)
                output = folder / f"{count}"
                rows[count], _ = run_sweep(block, output, cluster=Cluster(cluster.scheduler_address))
                seconds[count] += time.perf_counter() - start_s
                core_s[count] += core_seconds(cluster) - start_core_s
            done = block.participants
            times = ", ".join(f"{count}: {seconds[count]:.0f} s" for count in WORKERS)
            print(f"{done} participants; {times}; load {os.getloadavg()[0]:.1f}", flush=True)
            if sum(seconds.values()) > 60 * given.minutes:
                break
    minutes = sum(row["steered_s"] for row in rows[1]) / 60
    print(f"{done} participants, {len(rows[1])} trials, {minutes:.0f} simulated minutes")
    for count in WORKERS:
        rate = minutes / (seconds[count] / 60)
        print(
            f"{count} workers: {seconds[count]:.0f} s, {rate:.0f} simulated minutes per minute; "
            f"{core_s[count]:.0f} s of CPU time, {60 * minutes / core_s[count]:.0f} simulated per CPU-second"
        )
    print(f"speed-up by the second worker: {seconds[1] / seconds[2]:.2f}")
    print(f"the results are {'equal' if rows[1] == rows[2] else 'NOT equal'}")


def core_seconds(cluster: LocalCluster) -> float:
    """Return the CPU time of a cluster and this program."""
    with Client(cluster, set_as_default=False) as client:
        return time.process_time() + sum(client.run(time.process_time).values())


if __name__ == "__main__":
    main()
