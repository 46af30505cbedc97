"""What an operator may set: every setting is an environment variable with a default."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

__all__ = ["Settings"]


def _default_data_dir() -> Path:
    home = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(home) / "wheelplan"


def _cores() -> int:
    return len(os.sched_getaffinity(0))


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of one server; field `queue_length` is read from WHEELPLAN_QUEUE_LENGTH, and so on.

    host, port            where to listen
    data_dir              maps live in data_dir/maps
    workers               planning processes, each doing one plan at a time
    queue_length          plans that may wait for a worker before new ones are refused
    max_time_budget   s   the largest time_budget a client may ask for
    deadline_grace    s   a worker that needs longer than time_budget + this is killed
    drain_grace       s   how long plans in flight may take to finish at shutdown
    max_body_bytes        the largest JSON body
    max_map_bytes         the largest map upload, yaml and image together
    max_map_cells         the largest map, width times height
    max_maps              maps kept in store
    max_store_bytes       what these may take on disk, all together
    """

    host: str = "127.0.0.1"
    port: int = 8000
    data_dir: Path = field(default_factory=_default_data_dir)
    workers: int = field(default_factory=_cores)
    queue_length: int = 64
    max_time_budget: float = 30.0
    deadline_grace: float = 5.0
    drain_grace: float = 30.0
    max_body_bytes: int = 1 << 20
    max_map_bytes: int = 32 << 20
    max_map_cells: int = 4096 * 4096
    max_maps: int = 1000
    max_store_bytes: int = 10 << 30

    def __post_init__(self) -> None:
        for name in (
            "workers",
            "max_time_budget",
            "max_body_bytes",
            "max_map_bytes",
            "max_map_cells",
            "max_maps",
            "max_store_bytes",
        ):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} must be positive, not {getattr(self, name)!r}")
        for name in ("queue_length", "deadline_grace", "drain_grace"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} must not be negative, not {getattr(self, name)!r}")
        if not 0 <= self.port < 1 << 16:
            raise ValueError(f"port must lie between 0 and 65535, not {self.port!r}")

    @classmethod
    def from_environment(cls, environment: Mapping[str, str] = os.environ) -> Settings:
        """The defaults, overridden by the WHEELPLAN_… variables that are set. Raises ValueError."""
        readers = {"str": str, "int": int, "float": float, "Path": Path}
        given = {}
        for setting in fields(cls):
            variable = f"WHEELPLAN_{setting.name.upper()}"
            if text := environment.get(variable, "").strip():
                try:
                    given[setting.name] = readers[str(setting.type)](text)
                except ValueError:
                    raise ValueError(f"{variable} must be a {setting.type}, not {text!r}") from None
        return cls(**given)
