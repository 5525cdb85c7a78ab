"""Start jobs in processes of their own, and pass on their answers."""

import asyncio
import pickle
import subprocess
import sys
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from haptigraph.child_process import child_environment

__all__ = ["Jobs"]

MODULE = "haptigraph.dashboard.jobs.main"
MAX_CONCURRENT = 2
BELOW_NORMAL = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)


class Jobs:
    """Run a few jobs at a time; the others wait.

    Args:
        folder: Their working folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._slots = asyncio.Semaphore(MAX_CONCURRENT)

    async def run(self, job: str, *arguments: Any) -> AsyncGenerator[tuple[dict[str, Any], bytes], None]:
        """Yield the messages of a job, as JSON and bytes; closing the generator kills it.

        Args:
            job: One of `main.JOBS`.
            arguments: Of the job; anything that can be pickled.
        """
        if self._slots.locked():
            yield {"type": "progress", "what": "waiting for other jobs", "done": 0, "total": 0}, b""
        async with self._slots:
            process = await self._start(job)
            try:
                if process.stdin is None or process.stdout is None:
                    return
                process.stdin.write(pickle.dumps(arguments))
                with suppress(ConnectionError):  # it has ended already; reported below
                    await process.stdin.drain()
                async for message in _messages(process.stdout):
                    yield message
                if code := await process.wait():
                    problem = f"the job ended unexpectedly (exit code {code}); see the terminal"
                    yield {"type": "problem", "problem": problem}, b""
            finally:
                if process.returncode is None:
                    process.kill()
                    await process.wait()

    async def _start(self, job: str) -> asyncio.subprocess.Process:
        """Start a job that imports from where this process does, and so nothing from its working folder."""
        return await asyncio.create_subprocess_exec(
            *(sys.executable, "-P", "-m", MODULE, job, str(self._folder)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=child_environment(),
            start_new_session=True,  # Ctrl-C goes to the parent only
            creationflags=BELOW_NORMAL,
        )


async def _messages(stream: asyncio.StreamReader) -> AsyncIterator[tuple[dict[str, Any], bytes]]:
    while True:
        try:
            length = int.from_bytes(await stream.readexactly(4), "big")
            content = msgspec.json.decode(await stream.readexactly(length))
            yield content, await stream.readexactly(content["bytes"])
        except asyncio.IncompleteReadError:
            return
