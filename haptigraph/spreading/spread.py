"""The one way to spread work: a function and many tasks -> results, as they are done.

The task of a worker that dies is repeated by another one.
"""

from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from functools import partial
from typing import Any, TypeVar

from haptigraph.errors import BadInput
from haptigraph.importing import load
from haptigraph.spreading.processes import in_processes
from haptigraph.spreading.tasks import Cluster, Killed
from haptigraph.version import __version__

__all__ = ["spread"]

Task = TypeVar("Task")
Result = TypeVar("Result")


def spread(
    work: Callable[[Task], Result],
    tasks: Iterable[Task],
    *,
    workers: int = 1,
    cluster: Cluster | None = None,
) -> Generator[tuple[Task, Result | Killed], None, None]:
    """Yield every task with its result, in the order of completion.

    Args:
        work: A function that every worker can import.
        tasks: Must be picklable; consumed on demand.
        workers: Number of processes on this machine.
        cluster: A Dask cluster to use instead of this machine.

    Raises:
        BadInput: If the cluster cannot be used, or a worker has another version of haptigraph.
        MissingExtra: If a cluster is given and Dask is not installed.
        HaptigraphError: If the cluster is lost meanwhile.
    """
    stamped = partial(_stamped, work)
    results: Generator[tuple[Task, Any], None, None] = (
        in_processes(stamped, tasks, workers)
        if cluster is None
        else load("haptigraph.spreading.cluster:on_cluster")(stamped, tasks, cluster)
    )
    with closing(results):
        for task, answer in results:
            if isinstance(answer, Killed):
                yield task, answer
                continue
            version, result = answer
            if version != __version__:
                problem = (
                    f"its workers have haptigraph {version}, this is {__version__}; use the same version"
                )
                raise BadInput(problem, cluster.address if cluster else None)
            yield task, result


def _stamped(work: Callable[[Task], Result], task: Task) -> tuple[str, Result]:
    """Return the worker's version of haptigraph, and the result of a task."""
    return __version__, work(task)
