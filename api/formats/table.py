"""CSV (RFC 4180): one row a sample, a heading line, SI units."""

from __future__ import annotations

import numpy as np

from api.formats.format import PlanDocument
from planner.problem import Problem

__all__ = ["write_csv"]


def write_csv(plan: PlanDocument, _: Problem) -> bytes:
    """time, x, y, theta, then the rate of each wheel and the angle of each steered wheel."""
    schedule, trajectory = plan["schedule"], plan["trajectory"]
    columns = {
        "time": schedule["time"],
        **{name: trajectory[name] for name in ("x", "y", "theta")},
        **{f"{name}.velocity": series["velocity"] for name, series in schedule["wheels"].items()},
        **{f"{name}.steering": series["angle"] for name, series in schedule["steering"].items()},
    }
    rows = np.column_stack(list(columns.values())).tolist()
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in rows), ""]).encode()
