"""A PostgreSQL server for tests, from Debian's package, with its own folder and a socket instead of a port."""

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

BINARIES = max(
    Path("/usr/lib/postgresql").glob("*/bin"), key=lambda path: int(path.parent.name), default=None
)
TIMEOUT_S = 90


@contextmanager
def postgres() -> Iterator[str]:
    """Run a server; yield the URL of a database."""
    assert BINARIES is not None
    folder = Path(tempfile.mkdtemp(prefix="haptigraph-pg-"))
    account = {}
    if os.geteuid() == 0:  # the server refuses to run as root
        user = pwd.getpwnam("postgres" if "postgres" in [u.pw_name for u in pwd.getpwall()] else "nobody")
        os.chown(folder, user.pw_uid, user.pw_gid)
        account = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
    run = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, **account}
    data = folder / "data"
    create = [
        BINARIES / "initdb",
        "-D",
        data,
        "-A",
        "trust",
        "-U",
        "tester",
        "--no-sync",
        "--no-locale",
        "-E",
        "UTF8",
    ]
    subprocess.run(create, check=True, **run)
    start = [BINARIES / "postgres", "-D", data, "-k", folder, "-c", "listen_addresses=", "-c", "fsync=off"]
    server = subprocess.Popen(start, **run)
    try:
        is_ready = [BINARIES / "pg_isready", "-h", folder, "-U", "tester", "-d", "postgres"]
        deadline = time.monotonic() + TIMEOUT_S
        while subprocess.run(is_ready, **run).returncode:
            assert server.poll() is None and time.monotonic() < deadline, "the server did not start"
            time.sleep(0.1)
        yield f"postgresql://tester@/postgres?host={folder}"
    finally:
        server.send_signal(signal.SIGINT)  # which closes open connections
        server.wait(TIMEOUT_S)
        shutil.rmtree(folder, ignore_errors=True)
