"""Work in processes and on a cluster: every result once, whatever becomes of the workers."""

import contextlib
import os
import shutil
import signal
import subprocess
from multiprocessing import active_children
from pathlib import Path

import pytest

from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.spreading import processes
from haptigraph.spreading.spread import spread
from haptigraph.spreading.tasks import ATTEMPTS, Cluster, Killed

LOCAL = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "silence_logs": 50}


def square(number):
    return number * number


def fail_at_three(number):
    if number == 3:
        raise BadInput("is three", "tasks")
    return number


def die_at_three(task):
    number, folder = task
    if number == 3:
        attempts = len(list(Path(folder).iterdir()))
        (Path(folder) / str(attempts)).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die_once(folder):
    with contextlib.suppress(FileExistsError):
        Path(folder).mkdir()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


@pytest.mark.parametrize("workers", [1, 3])
def test_every_task_gives_its_result_once(workers):
    results = list(spread(square, range(20), workers=workers))
    assert sorted(results) == [(number, number * number) for number in range(20)]
    assert active_children() == []


def test_without_tasks_no_process_starts():
    assert list(spread(square, [], workers=3)) == []
    assert active_children() == []


def test_tasks_are_taken_on_demand():
    taken = []
    results = spread(square, (taken.append(number) or number for number in range(100)), workers=2)
    next(results)
    assert len(taken) <= 4
    results.close()
    assert active_children() == []


def test_a_worker_of_another_version_is_refused(monkeypatch):
    monkeypatch.setattr("haptigraph.spreading.spread.__version__", "0.0.1")  # here, not in the worker
    with pytest.raises(BadInput, match=r"its workers have haptigraph \S+, this is 0\.0\.1; use the same"):
        list(spread(square, [1, 2]))
    assert active_children() == []


def test_an_exception_of_a_task_is_raised_and_ends_the_workers():
    with pytest.raises(BadInput, match="tasks: is three"):
        list(spread(fail_at_three, range(10), workers=2))
    assert active_children() == []


def test_the_task_of_a_killed_worker_is_repeated(tmp_path):
    folders = [tmp_path / str(number) for number in range(3)]
    assert sorted(spread(die_once, folders, workers=2)) == [(folder, "done") for folder in folders]


def test_workers_that_die_while_they_start_are_not_blamed_on_their_task(monkeypatch):
    started = []

    class DyingAtFirst(processes._Worker):
        def __init__(self, work, attempts=0):
            super().__init__(work, attempts)
            started.append(self)
            if len(started) <= ATTEMPTS + 2:
                self._process.kill()

    monkeypatch.setattr(processes, "_Worker", DyingAtFirst)
    assert list(spread(square, [3])) == [(3, 9)]
    assert len(started) == ATTEMPTS + 3


def test_workers_that_never_start_end_the_work(monkeypatch):
    class Dying(processes._Worker):
        def __init__(self, work, attempts=0):
            super().__init__(work, attempts)
            self._process.kill()

    monkeypatch.setattr(processes, "_Worker", Dying)
    monkeypatch.setattr(processes, "MAX_FAILED_STARTS", 5)
    with pytest.raises(HaptigraphError, match="5 worker processes in a row died before they took a task"):
        list(spread(square, [3]))
    assert active_children() == []


def test_a_task_that_kills_every_worker_is_given_up_and_the_others_are_done(tmp_path):
    results = dict(spread(die_at_three, [(number, tmp_path) for number in range(6)], workers=2))
    assert {number: result for (number, _), result in results.items()} == {
        0: 0, 1: 1, 2: 2, 3: Killed(), 4: 4, 5: 5,
    }  # fmt: skip
    assert len(list(tmp_path.iterdir())) == ATTEMPTS


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """A folder with a certificate that is its own authority."""
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl")
    folder = tmp_path_factory.mktemp("tls")
    files = ["-keyout", folder / "key.pem", "-out", folder / "cert.pem"]
    subject = ["-subj", "/CN=haptigraph test", "-days", "2"]
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", *files, *subject]
    subprocess.run(command, check=True, capture_output=True)
    shutil.copy(folder / "cert.pem", folder / "ca.pem")
    return folder


def test_a_cluster_with_tls_admits_only_those_with_a_certificate(certificates, tmp_path, monkeypatch):
    from distributed import LocalCluster, Security  # here, because every worker imports this file

    ca, cert, key = (str(certificates / f"{name}.pem") for name in ("ca", "cert", "key"))
    ends = {
        f"tls_{end}_{what}": path
        for end in ("scheduler", "worker", "client")
        for what, path in (("cert", cert), ("key", key))
    }
    security = Security(tls_ca_file=ca, require_encryption=True, **ends)
    with LocalCluster(**LOCAL, processes=False, security=security, protocol="tls://") as cluster:
        address = cluster.scheduler_address
        assert address.startswith("tls://")
        assert sorted(spread(square, range(9), cluster=Cluster(address, certificates))) == [
            (number, number * number) for number in range(9)
        ]
        monkeypatch.setattr("haptigraph.spreading.cluster.TIMEOUT_S", 1)
        with pytest.raises(BadInput, match="no scheduler responds"):
            list(spread(square, [1], cluster=Cluster(address)))


@pytest.mark.parametrize(
    ("address", "tls", "is_exposed"),
    [
        ("tcp://127.0.0.1:8786", None, False),
        ("tcp://localhost:8786", None, False),
        ("tcp://lab-1:8786", None, True),
        ("tls://lab-1:8786", Path("certificates"), False),
    ],
)
def test_only_a_cluster_on_a_network_without_tls_is_exposed(address, tls, is_exposed):
    assert Cluster(address, tls).is_exposed is is_exposed
