"""Options of the commands that spread their work: processes of this machine, or a Dask cluster."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from haptigraph.commands.terminal import print_status
from haptigraph.errors import BadInput

if TYPE_CHECKING:
    from haptigraph.spreading.tasks import Cluster

__all__ = ["cluster_of", "cluster_options", "usable_cores", "workers_option"]

Command = TypeVar("Command", bound=Callable[..., Any])

workers_option = click.option(
    "--workers",
    type=click.IntRange(min=1),
    help="Parallel processes; one per core if not given. The results do not depend on it.",
)


def cluster_options(command: Command) -> Command:
    """Add --cluster and --tls to a command."""
    address = click.option(
        "--cluster",
        "--scheduler",
        metavar="ADDRESS",
        help="Of a Dask scheduler, instead of this machine: tcp://HOST:8786 or tls://HOST:8786.",
    )
    tls = click.option(
        "--tls", metavar="FOLDER", help="With --cluster tls://...: ca.pem, cert.pem and key.pem."
    )
    return address(tls(command))


def cluster_of(address: str | None, tls: str | None) -> "Cluster | None":
    """Return the cluster that the options name, with a warning if it is open to a network.

    Raises:
        BadInput: If the options contradict each other.
    """
    from haptigraph.spreading.tasks import Cluster

    if address is None and tls is None:
        return None
    if address is None or (tls is not None) != address.startswith("tls://"):
        raise BadInput("--tls FOLDER goes with --cluster tls://HOST:PORT, and that with --tls FOLDER")
    cluster = Cluster(address, Path(tls) if tls else None)
    if cluster.is_exposed:
        print_status(
            f"haptigraph: {address}: Dask executes the code that its network sends, and this connection has "
            "no TLS: use it only on a network you trust"
        )
    return cluster


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
