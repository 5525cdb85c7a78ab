"""The one way to spread work: a function and many tasks -> results, as they are done.

The task of a worker that dies is repeated by another one.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from haptigraph.importing import load
from haptigraph.spreading.processes import in_processes
from haptigraph.spreading.tasks import Cluster, Killed

__all__ = ["spread"]

Task = TypeVar("Task")
Result = TypeVar("Result")


def spread(
    work: Callable[[Task], Result],
    tasks: Iterable[Task],
    *,
    workers: int = 1,
    cluster: Cluster | None = None,
) -> Iterator[tuple[Task, Result | Killed]]:
    """Yield every task with its result, in the order of completion.

    Args:
        work: A function that every worker can import.
        tasks: Must be picklable; consumed on demand.
        workers: Number of processes on this machine.
        cluster: A Dask cluster to use instead of this machine.

    Raises:
        BadInput: If the cluster cannot be used.
        MissingExtra: If a cluster is given and Dask is not installed.
        HaptigraphError: If the cluster is lost meanwhile.
    """
    if cluster is None:
        return in_processes(work, tasks, workers)
    on_cluster = load("haptigraph.spreading.cluster:on_cluster")
    results: Iterator[tuple[Task, Result | Killed]] = on_cluster(work, tasks, cluster)
    return results
