"""The forms in which a plan is handed on. FORMATS is the registry: negotiation, the OpenAPI document and the
command line all read it."""

from __future__ import annotations

from api.errors import FieldErrors, Refusal
from api.formats import choreo, ros, table, vda5050, wpilib
from api.formats.format import Format, PlanDocument
from api.strict_json import write_json
from planner.problem import Problem

__all__ = ["BY_MEDIA_TYPE", "FORMATS", "Format", "PlanDocument", "find_format", "formats_for", "refuse_drive"]


def _json(plan: PlanDocument, _: Problem) -> bytes:
    return write_json(plan)


def _msgpack(plan: PlanDocument, _: Problem) -> bytes:
    import ormsgpack  # only workers write

    return ormsgpack.packb(plan, option=ormsgpack.OPT_SERIALIZE_NUMPY)


def _svg(plan: PlanDocument, problem: Problem) -> bytes:
    from api.picture import draw_plan  # matplotlib is slow to import, and few ask for pictures

    return draw_plan(problem, plan, "svg")


def _png(plan: PlanDocument, problem: Problem) -> bytes:
    from api.picture import draw_plan

    return draw_plan(problem, plan, "png")


def _own(name: str) -> str:
    """The media type of a form whose makers have registered none."""
    return f"application/vnd.wheelplan.{name}+json"


FORMATS: dict[str, Format] = {
    made.name: made
    for made in (
        Format("json", "application/json", "The plan", _json),
        Format("csv", "text/csv", "The schedule as a table", table.write_csv),
        Format("msgpack", "application/msgpack", "The plan in MessagePack", _msgpack),
        Format("svg", "image/svg+xml", "Floor plan and wheel charts", _svg),
        Format("png", "image/png", "The same as pixels", _png),
        Format(
            "ros-trajectory", _own("ros-trajectory"),
            "nav_msgs/Trajectory of ROS 2, as JSON", ros.write_trajectory,
        ),
        Format(
            "ros-joint-trajectory", _own("ros-joint-trajectory"),
            "trajectory_msgs/JointTrajectory of ROS 2, as JSON", ros.write_joint_trajectory,
        ),
        Format("vda5050-2.1", _own("vda5050-2.1"), "An order of VDA 5050 2.1", vda5050.write_2_1),
        Format(
            "vda5050-3.0", _own("vda5050-3.0"),
            "An order of VDA 5050 3.0 and a polyline with times", vda5050.write_3_0,
        ),
        Format("wpilib", _own("wpilib"), "A trajectory of WPILib", wpilib.write_wpilib),
        Format(
            "choreo", _own("choreo"), "A .traj of Choreo", choreo.write_choreo, ("differential", "swerve")
        ),
    )
}  # fmt: skip
"""Every format by its name, the default first."""

BY_MEDIA_TYPE = {each.media_type: each for each in FORMATS.values()}


def find_format(name: str) -> Format:
    """The format of this name. Raises FieldErrors."""
    if name not in FORMATS:
        bound = f"one of {', '.join(FORMATS)}"
        detail = f"format is {name[:40]!r}; it must be {bound}."
        raise FieldErrors([{"parameter": "format", "detail": detail, "value": name[:40], "bound": bound}])
    return FORMATS[name]


def formats_for(drive: str | None) -> list[Format]:
    """The formats that a plan of this type of drive can be had in; None: those of some drive."""
    return [each for each in FORMATS.values() if each.suits(drive)]


def refuse_drive(wanted: Format, drive: str) -> Refusal:
    """The answer to a client who asks for a format that is not for its drive."""
    others = ", ".join(each.name for each in formats_for(drive))
    return Refusal(
        "not-acceptable",
        f"{wanted.name} is for {' and '.join(wanted.drives)} drives; for {drive} there are {others}.",
    )
