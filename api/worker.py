"""One worker process: how the server starts it, talks to it and ends it, and what it does.

Workers are forked from a fork server that has imported and warmed the planner once, so that a replacement is
ready in milliseconds. On Linux the kernel ends them when the server is gone; elsewhere they end with the job
that they are doing.
"""

from __future__ import annotations

import asyncio
import ctypes
import fcntl
import math
import os
import pickle
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from multiprocessing import forkserver, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Literal

from api.spool import Spool, dumps, loads, send

__all__ = ["Worker", "adopt_orphans", "report", "stop_fork_server"]

Kind = Literal["taken", "progress", "result", "error"]

_OUT_OF_MEMORY = 97
"""Exit status of a worker that its memory limit has stopped."""

_LONGEST_START = 600.0
"""The first worker waits for the fork server to import and compile everything, s."""

_UNKNOWN = 255
"""Exit status of a worker whose fork server has died."""

_SUBREAPER = 36
"""PR_SET_CHILD_SUBREAPER of Linux."""

_context = get_context("forkserver")


class Worker:
    """A process that is up.

    preload: modules that the fork server imports before it forks; the worker is up when it has them.
    memory: what it may allocate, in bytes; 0: unlimited. Raises OSError or EOFError where it does not start.
    """

    def __init__(self, preload: Sequence[str], memory: int) -> None:
        _context.set_forkserver_preload(list(preload))
        self._pipe, theirs = _context.Pipe()
        watched, self._lifeline = _context.Pipe(duplex=False)
        arguments = (theirs, watched, preload, memory)
        self._process = _context.Process(target=_work, args=arguments, daemon=True)
        self.ended: asyncio.Future[None]
        try:
            self._process.start()
            theirs.close()
            watched.close()
            if not self._pipe.poll(_LONGEST_START):
                raise OSError(f"not up after {_LONGEST_START:g} s")
            self._pipe.recv_bytes()
        except BaseException:
            self._lifeline.close()
            self.kill()
            raise
        self._swollen = (self._allocated() + memory) / 2 if memory else math.inf

    @property
    def pid(self) -> int | None:
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Negative: the signal that ended it. None while it runs."""
        return self._process.exitcode

    @property
    def out_of_memory(self) -> bool:
        """Whether it has ended at its memory limit."""
        return self.exit_code == _OUT_OF_MEMORY

    @property
    def swollen(self) -> bool:
        """Whether half of what it could allocate when it was new is allocated. False except on Linux."""
        return self._allocated() > self._swollen

    def _allocated(self) -> int:
        """What its memory limit counts (and its stack), bytes; 0: not known."""
        try:
            pages = Path(f"/proc/{self.pid}/statm").read_text().split()[5]
        except OSError:
            return 0
        return int(pages) * resource.getpagesize()

    def watch(self) -> None:
        """From now on `ended` is done when the process has ended."""
        loop = asyncio.get_running_loop()
        ended = self.ended = loop.create_future()

        def end() -> None:
            loop.remove_reader(self._process.sentinel)
            ended.set_result(None)

        loop.add_reader(self._process.sentinel, end)

    def unwatch(self) -> None:
        asyncio.get_running_loop().remove_reader(self._process.sentinel)

    def exchange(
        self,
        job: bytes,
        taken: Callable[[], object],
        progress: Callable[[Any], object],
        spools: Sequence[Spool] = (),
    ) -> tuple[Kind, Any]:
        """Has the worker do a job, and waits: ("result" or "error", what it returned or raised).

        Raises EOFError or OSError where the process ends, and whatever unpickling raises.
        """
        try:
            send(self._pipe, job, spools)
            while True:
                kind, value = loads(self._pipe.recv_bytes(), self._pipe)
                if kind == "taken":
                    taken()
                elif kind == "progress":
                    progress(value)
                else:
                    return kind, value
        except (EOFError, OSError):
            self.join()  # its exit code arrives a little later
            raise

    def kill(self) -> None:
        """Kills the process."""
        if self._process.pid is not None:
            self._process.kill()

    def join(self) -> None:
        """Waits for the end of the process, for a second at most."""
        self._process.join(1.0)

    def discard(self) -> None:
        """Kills the process and waits for its end. Nobody may be using the pipe."""
        self.kill()
        self._lifeline.close()
        self._process.join()
        self._pipe.close()
        # Its fork server has died, so it may have become our child.
        if self.exit_code == _UNKNOWN and self.pid is not None:
            _reap(self.pid)


def adopt_orphans() -> None:
    """Makes workers our children when their fork server dies, so that we can reap them; process 1 may not.
    Linux only."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_SUBREAPER, 1, 0, 0, 0)


def stop_fork_server() -> None:
    """Ends the fork server, so that no thread of ours waits any longer for it to import what it should, and
    waits for its end."""
    server: Any = forkserver._forkserver
    with server._lock:
        if server._forkserver_pid is not None:
            os.kill(server._forkserver_pid, signal.SIGKILL)
            server._stop_unlocked()


def _reap(pid: int) -> None:
    """Reaps a killed process that is about to become our child, unless another process does within 1 s."""
    until = time.monotonic() + 1.0
    with suppress(ProcessLookupError):
        while time.monotonic() < until:
            with suppress(ChildProcessError):  # its old parent's pipes close before we are the new one
                os.waitpid(pid, 0)
                return
            os.kill(pid, 0)
            time.sleep(0.01)


_caller: Connection | None = None
"""In a worker: where the caller of the present job hears of its progress, if it wants to."""


def report(value: Any) -> None:
    """Tells the caller of the present job how far it is. Outside a worker, or where nobody asked: nothing."""
    if _caller is not None:
        _send(_caller, "progress", value)


def _send(pipe: Connection, kind: Kind, value: Any = None) -> None:
    send(pipe, *dumps((kind, value)))


def _work(pipe: Connection, lifeline: Connection, preload: Sequence[str], memory: int) -> None:
    """In the worker: does one job after the other until the pipe closes."""
    # Signals to the whole process group are the server's to answer; its plans in flight may finish.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if sys.platform == "linux":
        # The server holds the other end of the lifeline. When it dies the kernel raises SIGIO here, whose
        # default is the end of the process, even while a solver holds the interpreter's lock.
        fcntl.fcntl(lifeline, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC)
    for module in preload:  # the fork server has them, unless it could not import them
        import_module(module)
    if memory:
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    with suppress(EOFError, OSError):
        pipe.send_bytes(b"up")
        while True:
            job = pipe.recv_bytes()
            _send(pipe, "taken")
            _do(pipe, job)


def _do(pipe: Connection, job: bytes) -> None:
    global _caller
    try:
        function, args, listens = loads(job, pipe)
        _caller = pipe if listens else None
        _send(pipe, "result", function(*args))
    except BaseException as error:
        # CasADi makes a RuntimeError of what C++ calls it.
        if isinstance(error, MemoryError) or "std::bad_alloc" in str(error):
            os._exit(_OUT_OF_MEMORY)  # who knows what is left undone
        error.add_note(traceback.format_exc())
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            stand_in = RuntimeError(f"{type(error).__name__}: {error}")
            stand_in.add_note(traceback.format_exc())
            error = stand_in
        _send(pipe, "error", error)
