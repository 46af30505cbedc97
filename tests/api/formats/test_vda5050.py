"""Orders of VDA 5050: valid to its schema; their curves, evaluated by geomdl, lead where the plan does."""

from __future__ import annotations

import json
import math
from datetime import datetime, timedelta
from typing import Any

import numpy as np
import pytest
import shapely
from geomdl import NURBS
from shapely import LineString, MultiLineString
from vda5050.model.order import Order
from vda5050.validation.schema_validator import SchemaValidator

from api.formats import FORMATS
from drives import DRIVES

PIVOT = (("start", (1.0, 1.0, 0.0)), ("goal", (1.0, 1.0, 2.0)))

# Section 7.3 of the specification, tag 3.0.0: (required, optional).
NODE = {"nodeId", "sequenceId", "released", "actions"}, {"nodeDescriptor", "nodePosition"}
EDGE = (
    {"edgeId", "sequenceId", "released", "actions"},
    {
        "edgeDescriptor", "maximumSpeed", "maximumMobileRobotHeight", "minimumLoadHandlingDeviceHeight",
        "orientation", "orientationType", "direction", "reachOrientationBeforeEntering",
        "maximumRotationSpeed", "trajectory", "length", "corridor",
    },
)  # fmt: skip


def written(name: str, planned: Any, *which: Any) -> tuple[dict[str, Any], dict[str, Any], Any]:
    """(what the format gives, the plan, its problem)"""
    plan, problem = planned(*which)
    return json.loads(FORMATS[name].write(plan, problem)), plan, problem


def curve_of(edge: dict[str, Any]) -> NURBS.Curve:
    made = NURBS.Curve()
    made.degree = edge["trajectory"]["degree"]
    made.ctrlpts = [[p["x"], p["y"]] for p in edge["trajectory"]["controlPoints"]]
    made.knotvector = edge["trajectory"]["knotVector"]
    return made


def evaluated(edge: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Dense points of an edge's curve, at least 20 between two knots, and its directions there."""
    curve = curve_of(edge)
    knots = np.unique(curve.knotvector)
    between = np.interp(np.linspace(0, len(knots) - 1, 20 * len(knots)), np.arange(len(knots)), knots)
    at = np.union1d(between, np.linspace(0, 1, 2 + int(edge["length"] / 2e-3)))
    frames = np.array([curve.derivatives(u, 1) for u in at])
    return frames[:, 0], np.arctan2(frames[:, 1, 1], frames[:, 1, 0])


def body_headings(plan: dict[str, Any], problem: Any) -> np.ndarray:
    fixed = problem.robot.drive.fixed_body_heading
    theta = plan["trajectory"]["theta"]
    return theta if fixed is None else np.full(len(theta), fixed)


@pytest.mark.parametrize("effort", ["first", "good"])
@pytest.mark.parametrize("drive", DRIVES)
def test_the_curves_stay_within_the_stated_error_which_is_below_5_mm(planned, drive, effort):
    told, plan, _ = written("vda5050-2.1", planned, drive, effort)
    curves = MultiLineString([evaluated(edge)[0] for edge in told["order"]["edges"]])
    way = LineString(np.column_stack([plan["trajectory"]["x"], plan["trajectory"]["y"]]))
    stated = told["fitError"]["position"]
    assert stated <= 5e-3
    assert shapely.distance(curves, shapely.points(way.coords)).max() <= stated + 1e-5
    # The way's own chords are 0.1 mm off at most, where it is curved most.
    assert shapely.distance(way, shapely.points(shapely.get_coordinates(curves))).max() <= stated + 2e-4


@pytest.mark.parametrize("drive", DRIVES)
def test_the_heading_is_the_orientation_within_the_stated_error(planned, drive):
    told, plan, problem = written("vda5050-2.1", planned, drive, "good")
    way = np.column_stack([plan["trajectory"]["x"], plan["trajectory"]["y"]])
    headings, moving = (
        body_headings(plan, problem),
        np.hypot(plan["trajectory"]["vx"], plan["trajectory"]["vy"]),
    )
    edges = [(edge, *evaluated(edge)) for edge in told["order"]["edges"]]
    for i in np.flatnonzero(moving > 0.2):
        apart = [np.hypot(*(points - way[i]).T) for _, points, _ in edges]
        # Beside a cusp the way back is as near as the way there.
        passing = min(each.min() for each in apart) + told["fitError"]["position"]
        within = []
        for (edge, _, directions), away in zip(edges, apart, strict=True):
            if away.min() <= passing:
                along = directions[away.argmin()] if edge["orientationType"] == "TANGENTIAL" else 0.0
                off = abs(math.remainder(along + edge["orientation"] - headings[i], 2 * math.pi))
                # Where an edge meets another, the nearest may be the neighbour.
                within.append(off - 0.11 * (edge["orientationType"] == "GLOBAL"))
        assert min(within) <= told["fitError"]["heading"] + 0.01
    assert told["fitError"]["heading"] <= 0.1 + 1e-9


@pytest.mark.parametrize("drive", DRIVES)
def test_an_order_of_2_1_is_valid_to_the_published_schema(planned, drive):
    told, _, _ = written("vda5050-2.1", planned, drive)
    assert SchemaValidator().errors("order", told["order"]) == []
    order = Order.model_validate(told["order"])
    for i, edge in enumerate(order.edges):
        assert (edge.start_node_id, edge.end_node_id) == (order.nodes[i].node_id, order.nodes[i + 1].node_id)
        assert edge.max_speed > 0
    numbers = sorted([n.sequence_id for n in order.nodes] + [e.sequence_id for e in order.edges])
    assert numbers == list(range(2 * len(order.nodes) - 1))


@pytest.mark.parametrize("drive", DRIVES)
def test_an_order_of_3_0_has_the_fields_of_its_specification(planned, drive):
    told, _, _ = written("vda5050-3.0", planned, drive)
    for parts, (required, optional) in ((told["order"]["nodes"], NODE), (told["order"]["edges"], EDGE)):
        for part in parts:
            assert required <= set(part) <= required | optional
    for edge in told["order"]["edges"]:
        curve = edge["trajectory"]
        degree, knots, points = curve["degree"], curve["knotVector"], curve["controlPoints"]
        assert len(knots) == len(points) + degree + 1
        assert knots[: degree + 1] == [0.0] * (degree + 1)
        assert knots[-degree - 1 :] == [1.0] * (degree + 1)
        assert knots == sorted(knots)
        assert max(knots[degree + 1 : -degree - 1].count(k) for k in knots) <= degree


@pytest.mark.parametrize("drive", DRIVES)
def test_edges_begin_and_end_at_their_nodes(planned, drive):
    told, plan, _ = written("vda5050-3.0", planned, drive, "good")
    nodes = [(n["nodePosition"]["x"], n["nodePosition"]["y"]) for n in told["order"]["nodes"]]
    for i, edge in enumerate(told["order"]["edges"]):
        points = edge["trajectory"]["controlPoints"]
        assert (points[0]["x"], points[0]["y"]) == pytest.approx(nodes[i], abs=1e-9)
        assert (points[-1]["x"], points[-1]["y"]) == pytest.approx(nodes[i + 1], abs=1e-9)
    for node, sample in ((nodes[0], 0), (nodes[-1], -1)):
        end = plan["trajectory"]["x"][sample], plan["trajectory"]["y"][sample]
        assert node == pytest.approx(end, abs=1e-3)


def test_a_cusp_ends_an_edge_and_what_is_driven_backwards_says_so(planned):
    told, plan, _ = written("vda5050-2.1", planned, "ackermann", "first")
    signs = np.sign(plan["trajectory"]["vx"][np.abs(plan["trajectory"]["vx"]) > 1e-6])
    ways = [edge["orientation"] for edge in told["order"]["edges"]]
    cusps = np.count_nonzero(np.diff(signs))
    assert cusps > 0
    assert np.count_nonzero(np.diff(ways)) == cusps
    assert {(-1.0 if way else 1.0) for way in ways} == set(signs)


def test_a_turn_on_the_spot_is_left_to_a_node(planned):
    told, _, _ = written("vda5050-2.1", planned, "differential", "first", PIVOT)
    (node,) = told["order"]["nodes"]
    assert told["order"]["edges"] == []
    assert node["nodePosition"]["theta"] == pytest.approx(2.0, abs=1e-6)


def test_a_plan_of_no_duration_is_one_node(planned):
    still = (("start", (1.0, 1.0, 0.5)), ("goal", (1.0, 1.0, 0.5)))
    told, _, _ = written("vda5050-3.0", planned, "omni", "first", still)
    assert [len(told["order"][part]) for part in ("nodes", "edges")] == [1, 0]
    assert len(told["intermediatePath"]["polyline"]) == 1
    assert told["fitError"] == {"position": 0.0, "heading": 0.0}


@pytest.mark.parametrize("drive", ["ackermann", "synchro"])
def test_the_polyline_of_3_0_has_a_time_of_arrival_for_every_sample(planned, drive):
    told, plan, problem = written("vda5050-3.0", planned, drive)
    waypoints = told["intermediatePath"]["polyline"]
    left = datetime.fromisoformat(told["order"]["timestamp"])
    headings = body_headings(plan, problem)
    assert len(waypoints) == len(plan["schedule"]["time"])
    for i, point in enumerate(waypoints):
        assert (point["x"], point["y"]) == (plan["trajectory"]["x"][i], plan["trajectory"]["y"][i])
        assert math.remainder(point["theta"] - headings[i], 2 * math.pi) == pytest.approx(0, abs=1e-9)
        assert abs(point["theta"]) <= math.pi
        due = datetime.fromisoformat(point["eta"]) - left
        assert due / timedelta(seconds=1) == pytest.approx(plan["schedule"]["time"][i], abs=2e-3)
