"""Run a function on many tasks on the machines of a Dask cluster.

Dask executes the code that its network sends: whoever reaches a scheduler without TLS can run programs on
its workers, and a scheduler can answer with code for this program. `Cluster.tls` admits only holders of a
certificate.
"""

from collections.abc import Callable, Generator, Iterable
from concurrent.futures import CancelledError
from contextlib import ExitStack
from itertools import islice
from typing import Any, TypeVar

from haptigraph.errors import BadInput, HaptigraphError, MissingExtra
from haptigraph.spreading.tasks import Cluster, Killed

try:
    from distributed import Client, KilledWorker, Security, as_completed
except ModuleNotFoundError:
    raise MissingExtra("a cluster", "cluster") from None

__all__ = ["on_cluster"]

Task = TypeVar("Task")
Result = TypeVar("Result")
TIMEOUT_S = 30
TASKS_PER_THREAD = 8
"""Tasks submitted ahead: all threads stay busy, and little is lost when this program ends."""
TLS_FILES = ("ca.pem", "cert.pem", "key.pem")


def on_cluster(
    work: Callable[[Task], Result], tasks: Iterable[Task], cluster: Cluster
) -> Generator[tuple[Task, Result | Killed], None, None]:
    """Yield every task with its result, in the order of completion.

    Args:
        work: A function that every worker can import.
        tasks: Must be picklable; consumed on demand.
        cluster: The cluster.

    Raises:
        BadInput: If the scheduler does not answer, or its workers lack haptigraph.
        HaptigraphError: If the scheduler is lost.
    """
    waiting = iter(tasks)
    with ExitStack() as stack:
        client = stack.enter_context(_client(cluster))
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
            except KilledWorker:
                result = Killed()
            except CancelledError:
                raise HaptigraphError(
                    f"{cluster.address}: the scheduler is lost; run the same again to resume"
                ) from None
            except ModuleNotFoundError as error:
                problem = f"its workers lack {error.name}; install the same haptigraph there"
                raise BadInput(problem, cluster.address) from None
            yield submitted.pop(future.key), result
            for next_one in submit(1):
                done.add(next_one)


def _client(cluster: Cluster) -> Client:
    security = _security(cluster)
    try:
        client = Client(cluster.address, timeout=TIMEOUT_S, set_as_default=False, security=security)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        raise BadInput(f"no scheduler responds ({error})", cluster.address) from None
    try:
        client.wait_for_workers(1, timeout=TIMEOUT_S)
    except TimeoutError:
        client.close()
        raise BadInput("the scheduler has no workers", cluster.address) from None
    return client


def _security(cluster: Cluster) -> Security:
    """Return the certificates; with them, every connection is encrypted and both ends are verified."""
    if cluster.tls is None:
        return Security()
    files = [cluster.tls / name for name in TLS_FILES]
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise BadInput(f"lacks {missing[0]}; a folder for TLS has {', '.join(TLS_FILES)}", cluster.tls)
    authority, certificate, key = map(str, files)
    return Security(
        tls_ca_file=authority, tls_client_cert=certificate, tls_client_key=key, require_encryption=True
    )
