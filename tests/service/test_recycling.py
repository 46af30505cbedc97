"""Workers that have done enough are replaced between two jobs, and what ends leaves no zombie."""

import asyncio
import operator
import os
import signal
import subprocess
import sys
import time

from tests.service.pools import gone, run, until
from tests.service.service import QUICK, ROOT, descendants, in_background, serving, slow, stat
from tests.service.service import until as wait_until

LEAK = "globals().setdefault('leak', []).append(bytearray(%d)) or __import__('os').getpid()"
"""Keeps so many bytes for ever, and tells the process."""


def zombies(pids):
    return [pid for pid in pids if os.path.exists(f"/proc/{pid}") and stat(pid)[0] == "Z"]


def test_a_worker_is_replaced_after_its_jobs_and_none_is_lost():
    async def promise(pool):
        pids = []
        while pool.recycled < 3:
            pids.append(await pool.run(os.getpid, deadline=5))
        assert len(set(pids)) >= 3
        assert (pool.restarts, pool.losses) == (0, {})
        await until(lambda: all(gone(pid) for pid in set(pids) - {pids[-1]}))

    run(promise, jobs=10)


def test_jobs_under_load_are_all_done_while_workers_are_replaced():
    async def promise(pool):
        while pool.recycled < 4:
            sums = await asyncio.gather(*(pool.run(operator.add, i, 1, deadline=20) for i in range(100)))
            assert sums == list(range(1, 101))
        assert pool.losses == {}

    run(promise, size=2, queue_length=500, jobs=10)


def test_the_old_worker_does_jobs_until_its_replacement_is_up():
    async def promise(pool):
        real = pool._fork
        pool._fork = lambda: (time.sleep(0.5), real())[1]
        waits = []
        while pool.recycled < 2:
            began = time.monotonic()
            await pool.run(os.getpid, deadline=5)
            waits.append(time.monotonic() - began)
            await asyncio.sleep(0.005)
        assert max(waits) < 0.4

    run(promise, jobs=10)


def test_a_worker_that_leaks_is_replaced_before_it_comes_to_its_memory_limit():
    async def promise(pool):
        pids = [await pool.run(eval, LEAK % (8 << 20), deadline=20) for _ in range(250)]
        assert len(set(pids)) >= 3
        assert pool.losses == {}

    run(promise, memory=1 << 30)


def test_a_worker_that_dies_while_its_replacement_starts_costs_no_job():
    async def promise(pool):
        for _ in range(10):
            pid = await pool.run(os.getpid, deadline=5)
            os.kill(pid, signal.SIGKILL)
            assert await pool.run(operator.add, 1, 2, deadline=5) == 3
        assert pool.recycled + pool.restarts >= 10

    run(promise, jobs=1)


def test_a_service_that_replaces_its_workers_loses_no_request(tmp_path):
    with serving(tmp_path, workers=2, worker_plans=3) as server:
        before = set(server.workers())
        joins = [in_background(lambda: [server.plan(QUICK) for _ in range(8)]) for _ in range(2)]
        assert [join() for join in joins] == [[(200, None)] * 8] * 2
        wait_until(lambda: server.metric("wheelplan_workers_recycled_total") >= 2, 10)
        wait_until(lambda: not before & set(server.workers()), 10)
        assert server.lost("crashed") == 0


def test_a_long_plan_is_finished_by_the_worker_that_is_to_be_replaced(tmp_path):
    with serving(tmp_path, workers=1, worker_plans=1) as server:
        for _ in range(2):
            assert server.plan(slow(0.5)) == (200, None)
        wait_until(lambda: server.metric("wheelplan_workers_recycled_total") >= 1, 10)


def test_a_fork_server_that_dies_leaves_no_zombie(tmp_path):
    with serving(tmp_path, workers=2) as server:
        family = descendants(server.process.pid)
        before = set(server.workers())
        os.kill(server.fork_server(), signal.SIGKILL)
        wait_until(lambda: len(server.workers()) == 2 and not before & set(server.workers()))
        wait_until(lambda: not zombies(family), 5)


def test_a_service_that_ends_leaves_no_zombie(tmp_path):
    """A process that adopts orphans and does not reap them, as process 1 of some containers, finds none."""
    code = f"""if True:
        import ctypes, os, time
        from tests.service.service import serving, stat

        ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER
        with serving({str(tmp_path)!r}, workers=2) as server:
            family = [*server.workers(), server.fork_server()]
            server.process.terminate()
            assert server.process.wait(30) == 0
            time.sleep(0.5)
            assert [stat(pid) for pid in family if os.path.exists(f"/proc/{{pid}}")] == []
    """
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, timeout=120)
