"""Run jobs in processes of their own, and pass on what they answer. Knows no job."""

import asyncio
import os
import pickle
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

import haptigraph

__all__ = ["Jobs"]

MODULE = "haptigraph.dashboard.jobs.main"
MOST_AT_ONCE = 2
BELOW_NORMAL = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)


class Jobs:
    """Start jobs, a few at a time; the others wait.

    Args:
        folder: Where they work.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._room = asyncio.Semaphore(MOST_AT_ONCE)

    async def frames(self, job: str, *given: Any) -> AsyncIterator[tuple[dict[str, Any], bytes]]:
        """Yield what a job answers; who stops listening ends it.

        Args:
            job: One of `job_main.JOBS`.
            given: What it is about; whatever can be pickled.
        """
        if self._room.locked():
            yield {"type": "progress", "what": "waiting for other work", "done": 0, "total": 0}, b""
        async with self._room:
            process = await self._start(job)
            try:
                if process.stdin is None or process.stdout is None:
                    return
                process.stdin.write(pickle.dumps(given))
                with suppress(ConnectionError):  # it has ended already, and how is told below
                    await process.stdin.drain()
                async for frame in _frames(process.stdout):
                    yield frame
                if code := await process.wait():
                    problem = f"the work ended by itself (exit code {code}); the terminal may say why"
                    yield {"type": "problem", "problem": problem}, b""
            finally:
                if process.returncode is None:
                    process.kill()
                    await process.wait()

    async def _start(self, job: str) -> asyncio.subprocess.Process:
        """Start a job that finds the very package that runs here, and nothing in the working directory."""
        package = str(Path(haptigraph.__file__).parents[1])
        paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
        return await asyncio.create_subprocess_exec(
            *(sys.executable, "-P", "-m", MODULE, job, str(self._folder)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            start_new_session=True,  # Ctrl-C is for the parent
            creationflags=BELOW_NORMAL,
        )


async def _frames(stream: asyncio.StreamReader) -> AsyncIterator[tuple[dict[str, Any], bytes]]:
    while True:
        try:
            length = int.from_bytes(await stream.readexactly(4), "big")
            content = msgspec.json.decode(await stream.readexactly(length))
            yield content, await stream.readexactly(content["bytes"])
        except asyncio.IncompleteReadError:
            return
