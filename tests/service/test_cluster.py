"""Plans on a real Dask cluster of two workers: killed processes and Dask workers, deadlines, leaving clients,
maps by id, and a service in front of it."""

import asyncio
import json
import operator
import os
import shutil
import signal
import time
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="the extra `cluster` is not installed")

from distributed import LocalCluster

from api.cluster import Cluster
from api.errors import Refusal
from api.fair_queue import Ticket
from tests.service.service import QUICK, Server, alive, serving, slow, stat, until

HANG = (sum, range(10**12))
"""Never ends, and never lets go of the interpreter's lock."""

WAREHOUSE = Path(__file__).parents[2] / "examples" / "warehouse"


@pytest.fixture(scope="module")
def storage(tmp_path_factory):
    """The data folder of the workers."""
    return tmp_path_factory.mktemp("storage")


@pytest.fixture(scope="module")
def dask(storage, tmp_path_factory):
    with LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        dashboard_address=":0",
        local_directory=str(tmp_path_factory.mktemp("scratch")),
        env={"WHEELPLAN_DATA_DIR": str(storage)},
    ) as cluster:
        yield cluster


def run(dask, promise, queue_length=10, queue_wait=10.0, queue_timeout=10.0):
    """Runs an async test against a cluster that is up."""

    async def main():
        cluster = Cluster(dask.scheduler_address, queue_length, queue_wait, queue_timeout)
        cluster.start()
        try:
            async with asyncio.timeout(300):
                while cluster.live < 2:
                    await asyncio.sleep(0.02)
            async with asyncio.timeout(60):
                await promise(cluster)
        finally:
            await cluster.close()

    asyncio.run(main())


async def refusal(awaitable):
    with pytest.raises(Refusal) as caught:
        await awaitable
    return caught.value.code


def napping(seconds):
    """A job that sleeps, and returns its process and its Dask worker."""
    return eval, f"(__import__('time').sleep({seconds}), {FAMILY})[1]"


FAMILY = "(__import__('os').getpid(), __import__('psutil').Process().parent().ppid())"


async def pair(cluster):
    """(process, Dask worker) of each of the two."""
    pairs = await asyncio.gather(*(cluster.run(*napping(0.3), deadline=10) for _ in range(2)))
    assert len(set(pairs)) == 2
    return pairs


async def begun(cluster, then):
    """Two jobs that are being done, and the processes that do them; what they do is an expression."""
    pids = []
    job = f"(__import__('api.workers').workers.report(__import__('os').getpid()), {then})"
    jobs = [asyncio.create_task(cluster.run(eval, job, deadline=60, progress=pids.append)) for _ in range(2)]
    while len(pids) < 2:
        await asyncio.sleep(0.01)
    return jobs, pids


async def ended(pids, count):
    """Waits until as many of the processes are gone."""
    while sum(map(alive, pids)) > len(pids) - count:
        await asyncio.sleep(0.01)


def test_jobs_are_done_and_what_they_raise_is_raised_here(dask):
    async def promise(cluster):
        assert await cluster.run(operator.add, 1, 2, deadline=5) == 3
        with pytest.raises(ZeroDivisionError) as caught:
            await cluster.run(operator.truediv, 1, 0, deadline=5)
        assert "Traceback" in caught.value.__notes__[0]
        assert len(await cluster.run(bytes, 10_000_000, deadline=5)) == 10_000_000

    run(dask, promise)


def test_both_workers_work_at_once_and_one_that_has_nothing_to_do_is_spare(dask):
    async def promise(cluster):
        workers = {worker for _, worker in await pair(cluster)}
        assert len(workers) == 2
        assert cluster.spare == 2
        jobs = [asyncio.create_task(cluster.run(time.sleep, 0.5, deadline=5)) for _ in range(3)]
        await asyncio.sleep(0.1)
        assert (cluster.spare, cluster.queued) == (0, 1)
        await asyncio.gather(*jobs)
        assert (cluster.spare, cluster.queued) == (2, 0)

    run(dask, promise)


def test_a_full_queue_refuses_and_so_does_one_that_does_not_move(dask):
    async def promise(cluster):
        jobs = [asyncio.create_task(cluster.run(time.sleep, 1.0, deadline=5)) for _ in range(3)]
        await asyncio.sleep(0.1)
        assert await refusal(cluster.run(operator.add, 1, 2, deadline=5)) == "overloaded"
        ends = await asyncio.gather(*jobs, return_exceptions=True)
        assert [getattr(end, "code", None) for end in ends] == [None, None, "overloaded"]
        assert cluster.shed == 2

    run(dask, promise, queue_length=1, queue_timeout=0.5)


def test_a_client_that_holds_all_workers_loses_one_to_another_who_waits(dask):
    async def promise(cluster):
        def long():
            ticket = Ticket(client="long", foreseen=60.0)
            return asyncio.create_task(cluster.run(time.sleep, 60, deadline=70, ticket=ticket))

        jobs = [long() for _ in range(2)]
        await asyncio.sleep(0.5)
        assert cluster.spare == 0
        assert await cluster.run(operator.add, 1, 2, deadline=5, ticket=Ticket(client="other")) == 3
        ended, running = await asyncio.wait(jobs, return_when=asyncio.FIRST_COMPLETED)
        assert [job.exception().code for job in ended] == ["overloaded"]
        (last,) = running
        last.cancel()
        await asyncio.wait({last})
        while cluster.spare < 2:
            await asyncio.sleep(0.01)

    run(dask, promise, queue_wait=1.0)


def test_a_process_killed_mid_plan_costs_its_own_job_alone(dask):
    async def promise(cluster):
        jobs, pids = await begun(cluster, "__import__('time').sleep(2)")
        os.kill(pids[0], signal.SIGKILL)
        ends = await asyncio.gather(*jobs, return_exceptions=True)
        assert sorted(getattr(end, "code", "done") for end in ends) == ["done", "worker-crashed"]
        assert cluster.losses == {"crashed": 1}
        assert await cluster.run(operator.add, 1, 2, deadline=5) == 3

    run(dask, promise)


def test_a_job_that_overruns_its_deadline_is_killed(dask):
    async def promise(cluster):
        pids = [pid for pid, _ in await pair(cluster)]
        began = time.monotonic()
        assert await refusal(cluster.run(*HANG, deadline=0.5)) == "deadline-exceeded"
        await ended(pids, 1)
        assert time.monotonic() - began < 5

    run(dask, promise)


def test_a_caller_who_leaves_takes_its_plan_along(dask):
    async def promise(cluster):
        jobs, pids = await begun(cluster, "sum(range(10**12))")
        for job in jobs:
            job.cancel()
        began = time.monotonic()
        await ended(pids, 2)
        assert time.monotonic() - began < 2
        assert await cluster.run(operator.add, 1, 2, deadline=5) == 3

    run(dask, promise)


def test_a_server_that_dies_takes_its_plans_along(dask, tmp_path):
    pids = []

    async def promise(cluster):
        pids.extend(pid for pid, _ in await pair(cluster))

    run(dask, promise)
    with serving(tmp_path, scheduler=dask.scheduler_address) as server:
        used = {pid: stat(pid)[2] for pid in pids}
        connections = [server.open(slow(20.0)) for _ in pids]
        until(lambda: all(stat(pid)[2] > used[pid] + 20 for pid in pids))  # both are at work
        server.process.kill()
        until(lambda: not any(map(alive, pids)), 5)
        for connection in connections:
            connection.close()


def test_progress_travels(dask):
    async def promise(cluster):
        seen = []
        job = (
            "[(__import__('api.workers').workers.report(i), __import__('time').sleep(0.3)) for i in range(3)]"
        )
        await cluster.run(eval, f"len({job})", deadline=10, progress=seen.append)
        assert seen == [0, 1, 2]

    run(dask, promise)


def test_a_plan_whose_dask_worker_is_killed_is_made_by_another(dask):
    async def promise(cluster):
        jobs = [asyncio.create_task(cluster.run(*napping(2.0), deadline=20)) for _ in range(2)]
        await asyncio.sleep(0.5)
        worker = await asyncio.to_thread(lambda: dask.workers[0].process.pid)
        os.kill(worker, signal.SIGKILL)
        ends = await asyncio.gather(*jobs)
        assert worker not in {parent for _, parent in ends}
        while cluster.live < 2:  # Dask's nanny has started it again
            await asyncio.sleep(0.05)

    run(dask, promise)


def test_a_service_plans_on_the_cluster_and_its_maps_reach_the_workers_by_id(dask, storage, tmp_path):
    with serving(tmp_path, scheduler=dask.scheduler_address, queue_length=1) as server:
        assert json.loads(server.call("/readyz")[2])["workers"] == 2
        status, _, body = server.call("/v1/plans", QUICK)
        assert status == 200, body
        asked = json.loads((WAREHOUSE / "mecanum.json").read_text())
        asked["environment"]["map"]["id"] = upload(server)
        assert server.plan(asked) == (404, "unknown-map")  # the workers' storage is not the server's
        shutil.copytree(tmp_path / "maps", storage / "maps", dirs_exist_ok=True)
        assert server.plan(asked) == (200, None)

        status, headers, body = server.call("/v1/batches", {"requests": [QUICK] * 10 + [slow(1.0)]})
        assert status == 202, body
        results = server.call(headers["location"] + "/results")[2].splitlines()
        assert sum("plan" in json.loads(line) for line in results) == 11


def test_a_service_is_ready_only_with_a_cluster_that_has_workers(tmp_path):
    with LocalCluster(
        n_workers=0, scheduler_port=0, dashboard_address=":0", local_directory=str(tmp_path)
    ) as empty:
        server = Server(tmp_path / "data", scheduler=empty.scheduler_address)
        try:
            until(lambda: server.port is not None)
            until(lambda: "no worker" in json.loads(server.call("/readyz")[2])["detail"])
            assert server.plan(QUICK) == (503, "draining")
            empty.close()
            until(lambda: "no connection" in json.loads(server.call("/readyz")[2])["detail"])
            assert server.call("/readyz")[0] == 503
            assert server.call("/livez")[0] == 200
            server.process.terminate()
            assert server.process.wait(20) == 0
        finally:
            server.end()


def upload(server):
    boundary = b"--part"
    parts = [
        b'%s\r\nContent-Disposition: form-data; name="%s"; filename="%s"\r\n\r\n%s\r\n'
        % (boundary, name, name, (WAREHOUSE / f"warehouse.{kind}").read_bytes())
        for name, kind in ((b"yaml", "yaml"), (b"image", "pgm"))
    ]
    import urllib.request

    request = urllib.request.Request(
        f"http://127.0.0.1:{server.port}/v1/maps",
        b"".join(parts) + b"%s--\r\n" % boundary,
        {"Content-Type": "multipart/form-data; boundary=part"},
    )
    return json.loads(urllib.request.urlopen(request, timeout=30).read())["id"]
