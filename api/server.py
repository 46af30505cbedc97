"""The HTTP server process: uvicorn, with a shutdown that lets plans in flight finish."""

from __future__ import annotations

import asyncio
import math
import resource
import socket
import time
from collections.abc import Callable
from threading import Thread
from types import FrameType

import numpy as np
import uvicorn
from fastapi import FastAPI

from api.app import create_app
from api.log import log, logging_to_stderr
from api.protocol import Protocol
from api.settings import Settings
from api.worker import adopt_orphans, stop_fork_server
from planner.environment import check_simple_polygon
from planner.kernels import make_ready

__all__ = ["serve"]

_OTHER_FILES = 256
"""Open files besides those of connections: pipes to workers, maps, logs. A connection may have a spool."""


_PROGRESS = 5.0
"""Seconds between two lines about the compilation of kernels."""


def serve(settings: Settings) -> int:
    """Runs the HTTP service until a signal ends it."""
    with logging_to_stderr():
        return _serve(settings)


def _serve(settings: Settings) -> int:
    _allow_files(2 * settings.max_connections + _OTHER_FILES)
    adopt_orphans()
    try:
        app = create_app(settings)
    except (OSError, ValueError) as error:
        log(event="cannot start", error=str(error))
        return 2
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        log_config=None,
        access_log=False,
        http=Protocol,
        timeout_graceful_shutdown=5,
        server_header=False,
        proxy_headers=bool(settings.forwarded_allow_ips),
        forwarded_allow_ips=settings.forwarded_allow_ips,
    )
    server = _Server(config, app)
    try:
        server.run()
    finally:
        app.state.pool.kill()  # where a second signal has cut the shutdown short
        stop_fork_server()
    return 0 if server.started else 1


def _allow_files(count: int) -> None:
    """Raises this process's limit on open files, as far as it may."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY:
        count = min(count, hard)
    if soft not in (resource.RLIM_INFINITY, count) and soft < count:
        resource.setrlimit(resource.RLIMIT_NOFILE, (count, hard))


def _warm_up() -> None:
    """Compiles the kernels if the cache lacks them, and loads those that the server itself calls."""
    make_ready(_log_progress())
    check_simple_polygon(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))


def _log_progress() -> Callable[[int, int], None]:
    last = -math.inf

    def progress(done: int, total: int) -> None:
        nonlocal last
        if done == total or time.monotonic() - last > _PROGRESS:
            last = time.monotonic()
            log(event="compiling kernels", done=done, total=total)

    return progress


class _Server(uvicorn.Server):
    """A first SIGTERM or SIGINT lets the plans in flight finish while probes still get their answers, and the
    exit status is 0. A second one stops at once."""

    def __init__(self, config: uvicorn.Config, app: FastAPI) -> None:
        super().__init__(config)
        self.app = app
        self.draining = False

    async def serve(self, sockets: list[socket.socket] | None = None) -> None:
        self.loop = asyncio.get_running_loop()
        await super().serve(sockets)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        for server in self.servers if self.started else ():
            host, port, *_ = server.sockets[0].getsockname()
            log(event="listening", host=host, port=port)
        Thread(target=_warm_up, daemon=True).start()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        # Not uvicorn's own: it stops listening at once, and in the end raises the signal again.
        if self.draining:
            self.should_exit = self.force_exit = True
            return
        self.draining = True
        asyncio.run_coroutine_threadsafe(self._drain(), self.loop)

    async def _drain(self) -> None:
        log(event="draining")
        await self.app.state.pool.drain(self.app.state.settings.drain_grace)
        self.should_exit = True
