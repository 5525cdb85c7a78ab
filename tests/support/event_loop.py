"""Run a coroutine whatever else runs in this thread: the browser's driver keeps an event loop of its own in it."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

__all__ = ["run_apart"]


def run_apart(coroutine):
    """Return what the coroutine returns, from an event loop in a thread of its own."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, coroutine).result()
