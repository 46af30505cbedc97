"""The OpenAPI document says what is true."""

import json
import re

import pytest

from api.drive_schemas import EXAMPLES
from api.errors import CODES


@pytest.fixture
def document(client):
    return client.get("/openapi.json").json()


def operations(document):
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield f"{method.upper()} {path}", operation


def test_every_route_of_the_contract_is_described(document):
    assert {name for name, _ in operations(document)} == {
        "POST /v1/plans", "POST /v1/batches", "GET /v1/batches/{id}", "GET /v1/batches/{id}/results",
        "DELETE /v1/batches/{id}", "GET /v1/drives", "POST /v1/kinematics/inverse",
        "POST /v1/kinematics/forward", "POST /v1/maps", "GET /v1/maps", "GET /v1/maps/{id}",
        "GET /v1/maps/{id}/image", "DELETE /v1/maps/{id}", "GET /livez", "GET /readyz", "GET /metrics",
        "GET /v1/limits",
    }  # fmt: skip
    for _, operation in operations(document):
        assert operation["summary"]
        assert operation["description"]


def test_every_reference_leads_somewhere(document):
    for name in re.findall(r'"#/components/schemas/([^"]+)"', json.dumps(document)):
        assert name in document["components"]["schemas"]


def test_every_schema_and_field_is_described(document):
    for name, schema in document["components"]["schemas"].items():
        assert schema.get("description"), name
        for field, about in schema.get("properties", {}).items():
            assert about.get("description"), f"{name}.{field}"


def numbers(schema, path):
    if schema.get("type") in ("number", "integer"):
        yield path, schema
    for part in ("anyOf", "oneOf"):
        for option in schema.get(part, []):
            yield from numbers(option, path)
    for part in ("items", "additionalProperties"):
        if isinstance(schema.get(part), dict):
            yield from numbers(schema[part], path)


def test_every_number_of_a_request_but_an_angle_has_both_bounds(document):
    requests = [
        s for n, s in document["components"]["schemas"].items() if s.get("additionalProperties") is False
    ]
    assert len(requests) > 20
    for schema in requests:
        for field, about in schema["properties"].items():
            for path, number in numbers(about, f"{schema['title']}.{field}"):
                bounds = (
                    {"minimum", "exclusiveMinimum"} & set(number),
                    {"maximum", "exclusiveMaximum"} & set(number),
                )
                assert all(bounds) or "rad." in about["description"], path


def test_every_code_is_announced_by_a_route(document):
    announced = {
        code
        for _, operation in operations(document)
        for response in operation["responses"].values()
        if "application/problem+json" in response.get("content", {})
        for code in response["description"].split(", ")
    }
    assert announced == set(CODES) - {"not-found", "method-not-allowed", "malformed-http"}


@pytest.mark.parametrize(
    ("path", "schema"),
    [
        ("/v1/plans", "PlanRequest"),
        ("/v1/kinematics/inverse", "InverseRequest"),
        ("/v1/kinematics/forward", "ForwardRequest"),
    ],
)
def test_every_example_of_a_body_works_when_posted(client, document, path, schema):
    examples = document["components"]["schemas"][schema]["examples"]
    assert examples
    for example in examples:
        answer = client.post(path, json=example)
        assert answer.status_code == 200, answer.text


def test_every_example_of_a_field_works_when_posted(client, document, body):
    """Footprints, obstacles, limits, options: each made of its fields' examples."""
    schemas = document["components"]["schemas"]

    def example(name):
        given = {}
        for field, about in schemas[name]["properties"].items():
            if "const" in about:
                given[field] = about["const"]
            elif about.get("examples"):
                given[field] = about["examples"][0]
        return given

    for footprint in ("PolygonFootprint", "RectangleFootprint", "CircleFootprint"):
        body["robot"]["footprint"] = example(footprint)
        assert client.post("/v1/plans", json=body).status_code == 200
    body["environment"]["obstacles"] = [example("PolygonObstacle"), example("CircleObstacle")]
    body["environment"]["bounds"] = example("BoundsSchema")
    body["robot"]["limits"] = example("LimitsSchema")
    body["options"] = example("OptionsSchema")
    body["start"] = example("StartSchema")
    body["goal"] = example("GoalSchema")
    for drive in EXAMPLES.values():
        body["robot"]["drive"] = drive
        body["start"].pop("steering", None)
        answer = client.post("/v1/plans", json=body)
        assert answer.status_code == 200, answer.text


def test_the_documentation_is_served(client):
    assert client.get("/docs").status_code == 200
