"""What an operator may set: every setting is an environment variable with a default."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

__all__ = ["Settings", "variable"]


def _default_data_dir() -> Path:
    home = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(home) / "wheelplan"


def _cores() -> int:
    """The processors that this process may use: as many as its affinity and its container's quota allow."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text().split()
        return max(1, min(cores, math.ceil(int(quota) / int(period))))
    except (OSError, ValueError):  # no cgroup, or no quota
        return cores


def variable(name: str) -> str:
    """The environment variable of a setting: WHEELPLAN_QUEUE_LENGTH sets queue_length."""
    return f"WHEELPLAN_{name.upper()}"


_READERS: dict[Any, tuple[Callable[[str], Any], str]] = {
    str: (str, "text"),
    int: (int, "a whole number"),
    float: (float, "a number"),
    Path: (Path, "a path"),
    Path | None: (Path, "a path"),
}
"""What each type of setting is read with, and what it is called."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of one server. `wheelplan settings` lists them."""

    host: Annotated[str, "address to listen on"] = "127.0.0.1"
    port: Annotated[int, "port to listen on"] = 8000
    data_dir: Annotated[Path, "maps live in its folder maps"] = field(default_factory=_default_data_dir)
    tokens_file: Annotated[Path | None, "bearer tokens, one a line; clients must send one of them"] = None
    forwarded_allow_ips: Annotated[
        str, "addresses of proxies whose X-Forwarded-For names the client, separated by commas; *: all"
    ] = ""
    workers: Annotated[int, "planning processes, each doing one plan at a time"] = field(
        default_factory=_cores
    )
    worker_memory: Annotated[int, "what a worker may allocate before it is stopped, bytes; 0: anything"] = (
        2 << 30
    )
    worker_plans: Annotated[int, "plans after which a worker is replaced by a fresh one; 0: never"] = 10_000
    queue_length: Annotated[int, "plans that may wait for a worker before new ones are refused"] = field(
        default_factory=lambda: 64 * _cores()
    )
    queue_wait: Annotated[float, "the wait for a worker beyond which new plans are refused, s"] = 1.0
    queue_timeout: Annotated[float, "the longest that a plan waits for a worker, s"] = 10.0
    max_time_budget: Annotated[float, "the largest time_budget a client may ask for, s"] = 30.0
    max_samples: Annotated[int, "the most samples that a plan may have"] = 200_000
    deadline_grace: Annotated[float, "a plan is stopped this long after its time_budget has ended, s"] = 5.0
    drain_grace: Annotated[float, "how long plans in flight may take to finish at shutdown, s"] = 30.0
    receive_timeout: Annotated[float, "how long a request may take to arrive, s; large bodies longer"] = 8.0
    max_body_bytes: Annotated[int, "the largest JSON body"] = 1 << 20
    max_map_bytes: Annotated[int, "the largest map upload, yaml and image together"] = 32 << 20
    max_map_cells: Annotated[int, "the largest map, width times height"] = 4096 * 4096
    max_maps: Annotated[int, "maps kept in store"] = 1000
    max_store_bytes: Annotated[int, "what these may take on disk, all together"] = 10 << 30
    max_upload_bytes: Annotated[int, "what map uploads may hold at once, all together, bytes"] = 128 << 20
    max_pending_bytes: Annotated[int, "what request bodies may hold at once, all together, bytes"] = 256 << 20
    max_connections: Annotated[int, "connections at once; idle ones make room for new ones"] = field(
        default_factory=lambda: max(1000, 128 * _cores())
    )
    max_batches: Annotated[int, "batches that may run at once"] = 8
    max_batch_bytes: Annotated[int, "the largest body of a batch"] = 8 << 20
    batch_keep: Annotated[float, "how long the results of a batch are kept after its end, s"] = 86400.0
    batch_store_bytes: Annotated[int, "results kept at most, in the folder batches; the oldest go first"] = (
        1 << 30
    )
    scheduler: Annotated[str, "a Dask scheduler, tcp://host:port, whose workers plan in place of ours"] = ""

    def __post_init__(self) -> None:
        may_be_zero = {"port", "worker_memory", "worker_plans", "queue_length"}
        may_be_zero |= {"deadline_grace", "drain_grace"}
        for setting in fields(self):
            name, value = setting.name, getattr(self, setting.name)
            if not isinstance(value, int | float):
                continue
            if name in may_be_zero and not 0 <= value < math.inf:
                raise ValueError(f"{variable(name)} must be finite and not negative, not {value!r}")
            if name not in may_be_zero and not 0 < value < math.inf:
                raise ValueError(f"{variable(name)} must be finite and positive, not {value!r}")
        if self.port >= 1 << 16:
            raise ValueError(f"{variable('port')} must lie between 0 and 65535, not {self.port!r}")

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ) -> Settings:
        """The defaults, overridden by the WHEELPLAN_… variables that are set. Raises ValueError."""
        given = {}
        for name, hint in get_type_hints(cls).items():
            read, kind = _READERS[hint]
            if text := environment.get(variable(name), "").strip():
                try:
                    given[name] = read(text)
                except ValueError:
                    raise ValueError(f"{variable(name)} must be {kind}, not {text!r}") from None
        return cls(**given)

    def table(self) -> list[tuple[str, str, str, str]]:
        """Every setting: its variable, present value, default and meaning."""
        default = Settings()
        hints = get_type_hints(Settings, include_extras=True)
        return [
            (
                variable(name),
                _shown(getattr(self, name)),
                _shown(getattr(default, name)),
                hint.__metadata__[0],
            )
            for name, hint in hints.items()
        ]


def _shown(value: Any) -> str:
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
