"""Spread work over the processes of this machine, or over the machines of a Dask cluster.

Turns a function and its arguments into results, as they come. Work that was on a worker that died is done
again elsewhere. Knows nothing of what the work is.
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
WAITS_S = 30
NO_PROFILER = {"distributed.worker.profile.enabled": False}  # it takes a tenth of the time
AHEAD = 8
"""So many tasks a thread are handed out at once: none is idle, and few are lost with this program."""


def spread(
    work: Callable[[Task], Result], tasks: Iterable[Task], *, workers: int = 1, scheduler: str = ""
) -> Iterator[tuple[Task, Result]]:
    """Yield every task with its result, in the order in which they are done.

    Args:
        work: Importable on every worker.
        tasks: Must be picklable; taken as they are needed.
        workers: Processes on this machine.
        scheduler: Address of a cluster's scheduler, in place of this machine.

    Raises:
        BadInput: If no such cluster answers, or its workers lack haptigraph.
        HaptigraphError: If workers died of a task again and again.
    """
    waiting = iter(tasks)
    with ExitStack() as stack:
        client = stack.enter_context(_client(stack, workers, scheduler))
        doing: dict[str, Task] = {}

        def hand_out(count: int) -> list[Any]:
            futures = []
            for task in islice(waiting, count):
                future = client.submit(work, task, pure=False)
                doing[future.key] = task
                futures.append(future)
            return futures

        done = as_completed(hand_out(AHEAD * sum(client.nthreads().values())), loop=client.loop)
        for future in done:
            try:
                result = future.result()
            except KilledWorker as error:
                raise HaptigraphError(f"workers died again and again ({error}); out of memory?") from None
            except ModuleNotFoundError as error:
                problem = f"its workers lack {error.name}; they need the same haptigraph as here"
                raise BadInput(problem, scheduler or "this machine") from None
            yield doing.pop(future.key), result
            for next_one in hand_out(1):
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
        client = Client(where, timeout=WAITS_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise BadInput(f"no scheduler answers there ({error})", scheduler) from None
    try:
        client.wait_for_workers(1, timeout=WAITS_S)
    except TimeoutError:
        client.close()
        raise BadInput("the scheduler has no worker", scheduler) from None
    return client
