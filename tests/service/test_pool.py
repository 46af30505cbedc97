"""The pool of workers, with functions that sleep, fail, hang and die in the planner's place."""

import asyncio
import math
import operator
import os
import signal
import threading
import time

import pytest

from api.errors import Refusal
from api.fair_queue import Ticket
from api.workers import Pool, report
from tests.service.pools import HANG, gone, refusal, run, until


def reporting(n):
    for i in range(n):
        report(i)
    return n


def reporting_then(function):
    report("begun")
    function()


def allocation_failing_as_in_casadi():
    raise RuntimeError("Error in Function::call for 'fastest':\nstd::bad_alloc\n")


def test_a_job_returns_what_its_function_returns():
    async def promise(pool):
        assert await pool.run(operator.add, 1, 2, deadline=5) == 3
        assert await pool.run(os.getpid, deadline=5) != os.getpid()
        assert len(await pool.run(bytes, 30_000_000, deadline=5)) == 30_000_000

    run(promise)


def test_a_job_raises_what_its_function_raises_with_the_workers_traceback_in_a_note():
    async def promise(pool):
        with pytest.raises(ValueError, match="math domain error") as caught:
            await pool.run(math.sqrt, -1, deadline=5)
        assert "Traceback" in caught.value.__notes__[0]
        assert await pool.run(operator.add, 1, 2, deadline=5) == 3
        assert pool.restarts == 0

    run(promise)


def test_a_result_that_cannot_travel_is_an_error_of_that_job_alone():
    async def promise(pool):
        with pytest.raises(Exception, match="pickle"):
            await pool.run(threading.Lock, deadline=5)
        with pytest.raises(Exception, match="pickle"):
            await pool.run(memoryview, b"x", deadline=5)
        assert await pool.run(operator.add, 1, 2, deadline=5) == 3

    run(promise)


@pytest.mark.parametrize(
    "job",
    [
        (os.abort,),
        (os._exit, 0),
        (signal.raise_signal, signal.SIGKILL),
        (signal.raise_signal, signal.SIGSEGV),
    ],
)
def test_a_job_that_kills_its_process_is_told_so_and_the_next_one_runs(job):
    async def promise(pool):
        assert await refusal(pool.run(*job, deadline=5)) == "worker-crashed"
        assert await pool.run(operator.add, 1, 2, deadline=5) == 3
        assert pool.restarts == 1

    run(promise)


def test_a_crash_costs_its_neighbours_nothing():
    async def promise(pool):
        neighbours = [asyncio.create_task(pool.run(time.sleep, 0.5, deadline=5)) for _ in range(2)]
        await asyncio.sleep(0.1)
        assert await refusal(pool.run(os.abort, deadline=5)) == "worker-crashed"
        assert await asyncio.gather(*neighbours) == [None, None]

    run(promise, size=3)


def test_a_job_that_needs_more_memory_than_the_limit_is_told_so_and_the_next_one_runs():
    async def promise(pool):
        assert len(await pool.run(bytes, 100 << 20, deadline=20)) == 100 << 20
        with pytest.raises(Refusal, match=f"more than {1 << 30} bytes of memory") as caught:
            await pool.run(list.__mul__, [0], 1 << 28, deadline=20)
        assert caught.value.code == "worker-crashed"
        assert await pool.run(operator.add, 1, 2, deadline=5) == 3
        assert await refusal(pool.run(allocation_failing_as_in_casadi, deadline=20)) == "worker-crashed"
        await until(lambda: pool.losses == {"memory": 2})

    run(promise, memory=1 << 30)


@pytest.mark.parametrize("job", [(time.sleep, 60), HANG], ids=["sleeps", "holds-the-lock"])
def test_a_job_that_overruns_its_deadline_is_killed_and_the_next_one_runs(job):
    async def promise(pool):
        pid = await pool.run(os.getpid, deadline=5)
        began = time.monotonic()
        assert await refusal(pool.run(*job, deadline=0.3)) == "deadline-exceeded"
        assert time.monotonic() - began < 0.8
        assert await pool.run(os.getpid, deadline=5) != pid
        assert gone(pid)

    run(promise)


def test_the_deadline_does_not_count_the_wait_in_the_queue():
    async def promise(pool):
        first = asyncio.create_task(pool.run(time.sleep, 0.6, deadline=5))
        await asyncio.sleep(0.05)
        assert await pool.run(operator.add, 1, 2, deadline=0.3) == 3
        await first

    run(promise)


@pytest.mark.parametrize("job", [(time.sleep, 60), HANG], ids=["sleeps", "holds-the-lock"])
def test_a_caller_who_leaves_frees_the_worker_within_half_a_second(job):
    async def promise(pool):
        task = asyncio.create_task(pool.run(*job, deadline=60))
        await asyncio.sleep(0.2)
        task.cancel()
        began = time.monotonic()
        assert await pool.run(operator.add, 1, 2, deadline=5) == 3
        assert time.monotonic() - began < 0.5

    run(promise)


def test_a_caller_who_leaves_the_queue_is_never_served():
    async def promise(pool):
        first = asyncio.create_task(pool.run(time.sleep, 0.4, deadline=5))
        await asyncio.sleep(0.05)
        second = asyncio.create_task(pool.run(time.sleep, 60, deadline=60))
        await asyncio.sleep(0.05)
        assert pool.queued == 1
        second.cancel()
        await asyncio.sleep(0.05)
        assert pool.queued == 0
        assert await pool.run(operator.add, 1, 2, deadline=5) == 3
        await first
        assert pool.restarts == 0

    run(promise)


def test_a_caller_who_asked_hears_what_the_job_reports_in_order_and_before_its_answer():
    async def promise(pool):
        heard = []
        assert await pool.run(reporting, 3, deadline=5, progress=heard.append) == 3
        assert heard == [0, 1, 2]
        assert await pool.run(reporting, 3, deadline=5) == 3
        assert heard == [0, 1, 2]
        assert await refusal(pool.run(reporting_then, os.abort, deadline=5, progress=heard.append))
        assert heard == [0, 1, 2, "begun"]

    run(promise)


def test_reporting_outside_a_worker_does_nothing():
    assert reporting(2) == 2


def test_workers_are_spare_unless_they_work_or_a_waiting_job_will_take_them():
    async def promise(pool):
        await until(lambda: pool.spare == 2)
        task = asyncio.create_task(pool.run(time.sleep, 0.3, deadline=5))
        await asyncio.sleep(0)
        assert pool.spare == 1
        more = [asyncio.create_task(pool.run(time.sleep, 0.3, deadline=5)) for _ in range(3)]
        await asyncio.sleep(0)
        assert pool.spare == 0
        await asyncio.gather(task, *more)
        await until(lambda: pool.spare == 2)

    run(promise, size=2)


def test_jobs_are_done_first_come_first_served():
    async def promise(pool):
        order = []

        async def job(i):
            await pool.run(time.sleep, 0.01, deadline=5)
            order.append(i)

        await asyncio.gather(*(job(i) for i in range(8)))
        assert order == list(range(8))

    run(promise)


@pytest.mark.parametrize("queue_length", [0, 2])
def test_a_full_queue_refuses_at_once_and_takes_jobs_again_when_there_is_room(queue_length):
    async def promise(pool):
        # All in one breath, before any worker has taken its job.
        taken = [asyncio.create_task(pool.run(time.sleep, 0.3, deadline=5)) for _ in range(2 + queue_length)]
        await asyncio.sleep(0)
        assert await refusal(pool.run(time.sleep, 0.3, deadline=5)) == "overloaded"
        await asyncio.sleep(0.1)
        assert await refusal(pool.run(time.sleep, 0.3, deadline=5)) == "overloaded"
        assert pool.queued == queue_length
        assert pool.shed == 2
        await asyncio.gather(*taken)
        assert await pool.run(operator.add, 1, 2, deadline=5) == 3

    run(promise, size=2, queue_length=queue_length)


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGSTOP, signal.SIGSEGV])
def test_a_worker_that_dies_or_is_stopped_idle_costs_no_request(sign):
    async def promise(pool):
        for _ in range(2):
            pid = await pool.run(os.getpid, deadline=5)
            os.kill(pid, sign)
            assert await pool.run(os.getpid, deadline=5) != pid
            assert gone(pid)

    run(promise)


def test_workers_that_die_idle_are_replaced_before_a_job_comes():
    async def promise(pool):
        pids = {await pool.run(os.getpid, deadline=5) for _ in range(8)}
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        await until(lambda: pool.restarts == len(pids) and pool.live == 2)
        assert pool.losses == {"crashed": len(pids)}

    run(promise, size=2)


def test_a_job_that_a_stopped_worker_did_not_take_keeps_its_place_in_the_queue():
    async def promise(pool):
        pid, order = await pool.run(os.getpid, deadline=5), []
        os.kill(pid, signal.SIGSTOP)

        async def job(i):
            await pool.run(time.sleep, 0.01, deadline=5)
            order.append(i)

        await asyncio.gather(*(job(i) for i in range(4)))
        assert order == [0, 1, 2, 3]
        assert pool.losses == {"stopped": 1}

    run(promise)


def test_workers_crash_in_a_loop_when_three_in_a_row_die_for_each_and_no_more_once_a_job_is_done():
    async def promise(pool):
        for i in range(6):
            assert pool.crash_loop == (i > 5)
            assert await refusal(pool.run(os.abort, deadline=5)) == "worker-crashed"
        await until(lambda: sum(pool.losses.values()) == 6)
        assert pool.crash_loop
        assert pool.ready  # jobs are taken: it may have been one caller's
        assert await pool.run(operator.add, 1, 2, deadline=5) == 3
        assert not pool.crash_loop

    run(promise, size=2)


def test_workers_lost_to_deadlines_and_leaving_callers_are_no_crash_loop():
    async def promise(pool):
        for _ in range(3):
            assert await refusal(pool.run(time.sleep, 60, deadline=0.05)) == "deadline-exceeded"
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(pool.run(time.sleep, 60, deadline=60), 0.5)
        await until(lambda: pool.losses == {"deadline": 3, "cancelled": 3})
        assert not pool.crash_loop

    run(promise)


def test_a_job_that_no_worker_takes_in_time_is_refused():
    async def promise(pool):
        first = asyncio.create_task(pool.run(time.sleep, 1.0, deadline=5))
        await asyncio.sleep(0.05)
        began = time.monotonic()
        assert await refusal(pool.run(operator.add, 1, 2, deadline=5)) == "overloaded"
        assert 0.25 < time.monotonic() - began < 0.9
        assert (pool.shed, pool.queued) == (1, 0)
        await first
        assert await pool.run(operator.add, 1, 2, deadline=5) == 3

    run(promise, queue_timeout=0.3)


def test_a_job_that_would_wait_too_long_is_refused_at_once():
    async def promise(pool):
        for _ in range(8):
            await pool.run(time.sleep, 0.1, deadline=5)
        jobs = [asyncio.create_task(pool.run(time.sleep, 0.1, deadline=5)) for _ in range(20)]
        began = time.monotonic()
        outcomes = await asyncio.gather(*jobs, return_exceptions=True)
        refused = [outcome for outcome in outcomes if isinstance(outcome, Refusal)]
        assert 5 <= len(refused) <= 16
        assert all(error.code == "overloaded" and error.details["retry_after"] >= 1 for error in refused)
        # Those that were let in have been done within the time that they may wait and their own.
        assert time.monotonic() - began < 1.5
        assert pool.shed == len(refused)

    run(promise, queue_length=100, queue_wait=0.8)


def test_a_job_that_is_known_to_take_long_shortens_the_queue_while_it_lasts_and_no_longer():
    async def promise(pool):
        jobs = [asyncio.create_task(pool.run(time.sleep, 0.3, deadline=5, ticket=Ticket(foreseen=20.0)))]
        jobs.append(asyncio.create_task(pool.run(operator.add, 1, 2, deadline=5)))
        await asyncio.sleep(0.05)
        with pytest.raises(Refusal) as caught:
            await pool.run(operator.add, 1, 2, deadline=5)
        assert (caught.value.code, caught.value.details) == ("overloaded", {"retry_after": 20})
        await asyncio.gather(*jobs)
        burst = [asyncio.create_task(pool.run(operator.add, 1, 2, deadline=5)) for _ in range(8)]
        assert await asyncio.gather(*burst) == [3] * 8

    run(promise, queue_wait=1.0)


def test_draining_lets_jobs_finish_and_takes_no_new_ones():
    async def promise(pool):
        running = [asyncio.create_task(pool.run(time.sleep, 0.3, deadline=5)) for _ in range(2)]
        await asyncio.sleep(0.05)
        drained = asyncio.create_task(pool.drain(10))
        await asyncio.sleep(0.05)
        assert await refusal(pool.run(operator.add, 1, 2, deadline=5)) == "draining"
        assert not pool.ready
        await drained
        assert await asyncio.gather(*running) == [None, None]

    run(promise)


def test_draining_ends_with_its_grace():
    async def promise(pool):
        running = asyncio.create_task(pool.run(*HANG, deadline=60))
        await asyncio.sleep(0.05)
        await pool.drain(0.2)
        assert await refusal(running) == "draining"

    run(promise)


def test_closing_leaves_no_process_even_if_it_holds_the_lock():
    pids = []

    async def promise(pool):
        pids.extend({await pool.run(os.getpid, deadline=5)})
        task = asyncio.create_task(pool.run(*HANG, deadline=60))
        await asyncio.sleep(0.1)
        task.cancel()
        pids.extend({await pool.run(os.getpid, deadline=5)})
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(asyncio.shield(pool.run(*HANG, deadline=60)), 0.1)

    run(promise)
    assert len(pids) == 2
    assert all(gone(pid) for pid in pids)


def test_a_worker_that_cannot_import_the_planner_never_counts_as_ready():
    async def main():
        pool = Pool(1, 1, preload=["no_such_module"])
        pool.start()
        await asyncio.sleep(1.5)
        assert not pool.ready
        assert await refusal(pool.run(operator.add, 1, 2, deadline=5)) == "draining"
        await pool.close()

    asyncio.run(main())


def test_handing_a_job_over_costs_less_than_a_millisecond():
    async def promise(pool):
        times = []
        for _ in range(200):
            began = time.perf_counter()
            await pool.run(operator.add, 1, 2, deadline=5)
            times.append(time.perf_counter() - began)
        assert sorted(times)[100] < 1e-3

    run(promise)
