"""A pool of workers for the length of one test."""

import asyncio

import pytest

from api.errors import Refusal
from api.workers import Pool

HANG = (sum, range(10**12))
"""Never ends, and never lets go of the interpreter's lock."""


def run(promise, size=1, queue_length=10, **more):
    """Runs an async test against a pool that is up."""

    async def main():
        pool = Pool(size, queue_length, **more)
        pool.start()
        try:
            await until(lambda: pool.live == size)
            async with asyncio.timeout(30):
                await promise(pool)
        finally:
            await pool.close()

    asyncio.run(main())


async def until(condition, within=20.0):
    async with asyncio.timeout(within):
        while not condition():
            await asyncio.sleep(0.005)


async def refusal(awaitable):
    with pytest.raises(Refusal) as caught:
        await awaitable
    return caught.value.code


def gone(pid):
    try:
        return open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True
