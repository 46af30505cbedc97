"""Imported by the fork server before it forks the first worker: the planner, loaded and compiled."""

from __future__ import annotations

from api import planning  # noqa: F401
from planner import warm_up

warm_up.warm_up()
