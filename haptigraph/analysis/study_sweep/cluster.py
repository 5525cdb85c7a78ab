"""Run a function in parallel, in processes on this machine or on the machines of a Dask cluster.

Yields results as they are done. The task of a worker that died is repeated elsewhere.
"""

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from itertools import islice
from typing import Any, TypeVar

from haptigraph.errors import BadInput, HaptigraphError, MissingExtra

try:
    import dask
    from distributed import Client, KilledWorker, LocalCluster, as_completed
except ModuleNotFoundError:
    raise MissingExtra("a sweep", "cluster") from None

__all__ = ["NO_PROFILER", "spread"]

Task = TypeVar("Task")
Result = TypeVar("Result")
TIMEOUT_S = 30
NO_PROFILER = {"distributed.worker.profile.enabled": False}  # it takes a tenth of the time
TASKS_PER_THREAD = 8
"""Tasks submitted ahead: all threads stay busy, and little is lost when this program ends."""


def spread(
    work: Callable[[Task], Result], tasks: Iterable[Task], *, workers: int = 1, scheduler: str = ""
) -> Iterator[tuple[Task, Result]]:
    """Yield every task with its result, in the order of completion.

    Args:
        work: A function that every worker can import.
        tasks: Must be picklable; consumed on demand.
        workers: Number of processes on this machine.
        scheduler: Address of a cluster's scheduler, instead of this machine.

    Raises:
        BadInput: If the scheduler does not answer, or its workers lack haptigraph.
        HaptigraphError: If a task repeatedly killed its worker.
    """
    waiting = iter(tasks)
    with ExitStack() as stack:
        client = stack.enter_context(_client(stack, workers, scheduler))
        submitted: dict[str, Task] = {}

        def submit(count: int) -> list[Any]:
            futures = []
            for task in islice(waiting, count):
                future = client.submit(work, task, pure=False)
                submitted[future.key] = task
                futures.append(future)
            return futures

        done = as_completed(submit(TASKS_PER_THREAD * sum(client.nthreads().values())), loop=client.loop)
        for future in done:
            try:
                result = future.result()
            except KilledWorker as error:
                raise HaptigraphError(f"workers died repeatedly ({error}); out of memory?") from None
            except ModuleNotFoundError as error:
                problem = f"its workers lack {error.name}; install the same haptigraph there"
                raise BadInput(problem, scheduler or "this machine") from None
            yield submitted.pop(future.key), result
            for next_one in submit(1):
                done.add(next_one)


def _client(stack: ExitStack, workers: int, scheduler: str) -> Client:
    where: Any = scheduler
    if not scheduler:
        stack.enter_context(dask.config.set(NO_PROFILER))
        where = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",  # any free port, so that several sweeps may run
            silence_logs=logging.CRITICAL,
        )
        stack.enter_context(where)
    try:
        client = Client(where, timeout=TIMEOUT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise BadInput(f"no scheduler responds ({error})", scheduler) from None
    try:
        client.wait_for_workers(1, timeout=TIMEOUT_S)
    except TimeoutError:
        client.close()
        raise BadInput("the scheduler has no workers", scheduler) from None
    return client
