"""In a Dask worker: the processes that plan.

A plugin holds a pool, as many processes as the Dask worker has threads, and offers them as a Dask resource
once they are up. Where the release of a job reaches its Dask worker, be it that a client left or that the
server died, the process that does the job is killed.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import pickle
from dataclasses import replace
from functools import cache
from typing import Any

from distributed import Reschedule, Worker, WorkerPlugin, get_worker

from api.convert import FindMap
from api.errors import Refusal
from api.maps import MapStore
from api.settings import Settings
from api.workers import local_pool
from planner.problem import Problem

__all__ = ["NAME", "Supervisor", "carry", "reported"]

NAME = "wheelplan"
"""What the plugin, the resource, the jobs and the events of their beginning are called."""


class Supervisor(WorkerPlugin):
    """In a Dask worker: the processes that plan, as many as it has threads."""

    idempotent = True  # several servers may share a cluster

    async def setup(self, worker: Worker) -> None:
        """Starts the processes; the Dask worker offers them once they are up."""
        # Dask's nanny makes its worker a daemon, which Python forbids children. Ours end with their parent.
        multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
        self._worker = worker
        self._jobs: dict[str, asyncio.Future[Any]] = {}
        self._reports: dict[str, asyncio.Queue[Any]] = {}
        size = worker.state.nthreads
        # Dask sends no more jobs than there are processes; one that waits, waits for a replacement.
        self._pool = local_pool(replace(Settings.from_environment(), queue_length=size), size)
        self._pool.start()
        self._offering = asyncio.create_task(self._offer())

    async def teardown(self, worker: Worker) -> None:
        """Ends them."""
        self._offering.cancel()
        await self._pool.close()

    def transition(self, key: Any, start: str, finish: str, **_: Any) -> None:
        """Kills what nobody waits for any longer."""
        if finish == "released" and (job := self._jobs.get(key)) is not None:
            job.cancel()

    async def carry(self, key: str, payload: bytes, deadline: float, listens: bool) -> tuple[bool, Any]:
        """A job in one of the processes: whether it was done, and what it returned or raised."""
        reports: asyncio.Queue[Any] = asyncio.Queue()
        progress = reports.put_nowait if listens else None
        job = asyncio.ensure_future(self._pool.run(_at_home, payload, deadline=deadline, progress=progress))
        self._jobs[key] = job
        if listens:
            self._reports[key] = reports
            self._worker.log_event(NAME, (key, self._worker.address))
        try:
            return True, await job
        except asyncio.CancelledError:
            if not job.cancelled():
                raise
            return False, None  # and nobody to hear it
        except Exception as error:
            if isinstance(error, Refusal) and error.code == "draining":
                raise Reschedule from None  # this Dask worker is about to leave
            return False, error
        finally:
            job.cancel()
            del self._jobs[key]
            self._reports.pop(key, None)

    async def reported(self, key: str) -> list[Any]:
        """What a job has reported since the last time; waits until there is something."""
        if (reports := self._reports.get(key)) is None:
            await asyncio.sleep(1.0)  # it is over, and who asks will know at once
            return []
        values = [await reports.get()]
        while not reports.empty():
            values.append(reports.get_nowait())
        return values

    async def _offer(self) -> None:
        offered = None
        while True:
            size = 0 if self._pool.trouble else self._pool.size
            if size != offered:
                await self._worker.set_resources(**{NAME: size})
                offered = size
            await asyncio.sleep(0.2)


async def carry(key: str, payload: bytes, deadline: float, listens: bool) -> tuple[bool, Any]:
    """The Dask task of one job: whether it was done, and what it returned or raised."""
    return await _supervisor(get_worker()).carry(key, payload, deadline, listens)


async def reported(key: str, dask_worker: Worker) -> list[Any]:
    """Asked of a Dask worker: what a job has reported since the last time."""
    return await _supervisor(dask_worker).reported(key)


def _supervisor(worker: Worker) -> Supervisor:
    supervisor = worker.plugins[NAME]
    assert isinstance(supervisor, Supervisor)
    return supervisor


def _at_home(payload: bytes) -> Any:
    """In a planning process: the function's result, its map read from this machine's storage."""
    function, args = pickle.loads(payload)
    with _maps().leased() as find_map:
        return function(*(_with_own_map(value, find_map) for value in args))


@cache
def _maps() -> MapStore:
    return MapStore(Settings.from_environment().data_dir / "maps", 1)


def _with_own_map(value: Any, find_map: FindMap) -> Any:
    if not isinstance(value, Problem) or (layer := value.environment.map) is None:
        return value
    own = replace(layer, directory=find_map(layer.id).directory)
    return replace(value, environment=replace(value.environment, map=own))
