"""A PostgreSQL server for tests, from Debian's package: its own folder, a socket, no port."""

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
PATIENCE_S = 90


@contextmanager
def postgres() -> Iterator[str]:
    """Serve; yields the URL of a database."""
    assert BINARIES is not None
    folder = Path(tempfile.mkdtemp(prefix="haptigraph-pg-"))
    whose = {}
    if os.geteuid() == 0:  # which the server refuses to run as
        user = pwd.getpwnam("postgres" if "postgres" in [u.pw_name for u in pwd.getpwall()] else "nobody")
        os.chown(folder, user.pw_uid, user.pw_gid)
        whose = {"user": user.pw_uid, "group": user.pw_gid, "extra_groups": []}
    run = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, **whose}
    data = folder / "data"
    made = [
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
    subprocess.run(made, check=True, **run)
    started = [BINARIES / "postgres", "-D", data, "-k", folder, "-c", "listen_addresses=", "-c", "fsync=off"]
    server = subprocess.Popen(started, **run)
    try:
        asked = [BINARIES / "pg_isready", "-h", folder, "-U", "tester", "-d", "postgres"]
        deadline = time.monotonic() + PATIENCE_S
        while subprocess.run(asked, **run).returncode:
            assert server.poll() is None and time.monotonic() < deadline, "the server did not start"
            time.sleep(0.1)
        yield f"postgresql://tester@/postgres?host={folder}"
    finally:
        server.send_signal(signal.SIGINT)  # without waiting for whoever is connected
        server.wait(PATIENCE_S)
        shutil.rmtree(folder, ignore_errors=True)
