"""Run a coroutine in another thread, because the browser's driver has an event loop in this one."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

__all__ = ["run_in_thread"]


def run_in_thread(coroutine):
    """Run a coroutine in an event loop of its own; return its result."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, coroutine).result()
