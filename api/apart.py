"""A call in a worker process of its own, on this machine.

Decoders of uploads run here, for they may crash, hang or need much memory.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any

from api.errors import Refusal
from api.spool import dumps
from api.worker import Worker

__all__ = ["apart"]

_LONGEST = 60.0
"""How long the work may take, s."""


def apart(
    function: Callable[..., Any],
    *args: Any,
    preload: Sequence[str],
    memory: int,
    deadline: float = _LONGEST,
) -> Any:
    """What function(*args) returns or raises in a process that ends with it. Blocks.

    preload and memory as for Worker; the process is killed after `deadline` s of work. Raises Refusal:
    worker-crashed, deadline-exceeded.
    """
    job, spools = dumps((function, args, False))
    worker = Worker(preload, memory)
    late = threading.Event()

    def stop() -> None:
        late.set()
        worker.kill()

    timer = threading.Timer(deadline, stop)
    timer.start()
    try:
        kind, value = worker.exchange(job, lambda: None, lambda _: None, spools)
    except (EOFError, OSError):
        if late.is_set():
            raise Refusal("deadline-exceeded", f"This was stopped after {deadline:g} s.") from None
        fate = f"needed more than {memory} bytes of memory" if worker.out_of_memory else "died"
        raise Refusal("worker-crashed", f"The process that worked on this request {fate}.") from None
    finally:
        timer.cancel()
        worker.discard()
    if kind == "error":
        raise value
    return value
