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


def leaves(schema, path=""):
    """(path, schema) of all that a field may hold and that is no other component."""
    for option in schema.get("anyOf", schema.get("oneOf", [schema])):
        if option.get("type") not in (None, "null"):
            yield path, option
        for part, sign in (("items", "[]"), ("additionalProperties", "{}")):
            if isinstance(option.get(part), dict):
                yield from leaves(option[part], path + sign)


def lacking(field, is_request):
    """What a field's documentation lacks, of description, unit, bounds and example."""
    found = list(leaves(field))
    if not field.get("description"):
        yield "description"
    if not ("$ref" in json.dumps(field) or {"examples", "const"} & field.keys()):
        yield "example"
    for path, schema in found:
        if schema["type"] in ("number", "integer"):
            if not ({"minimum", "exclusiveMinimum"} & schema.keys()):
                yield f"lower bound {path}"
            if not ({"maximum", "exclusiveMaximum"} & schema.keys()):
                yield f"upper bound {path}"
            if not field.get("x-unit"):
                yield f"unit {path}"
        elif (is_request and schema["type"] == "array" and "maxItems" not in schema) or (
            is_request
            and schema["type"] == "string"
            and not {"enum", "const", "maxLength", "pattern"} & schema.keys()
        ):
            yield f"bound {path}"


def test_every_field_has_a_description_a_unit_bounds_and_an_example(document):
    lists = []
    for name, schema in document["components"]["schemas"].items():
        is_request = schema.get("additionalProperties") is False
        for field, about in schema.get("properties", {}).items():
            lists += [f"{name}.{field}: {what}" for what in lacking(about, is_request)]
    assert lists == []
    assert (
        sum(s.get("additionalProperties") is False for s in document["components"]["schemas"].values()) > 20
    )


@pytest.mark.parametrize(
    ("field", "lacks"),
    [
        ({"type": "number"}, {"description", "example", "lower bound ", "upper bound ", "unit "}),
        (
            {"type": "array", "items": {"type": "string"}, "description": "x", "examples": [1]},
            {"bound ", "bound []"},
        ),
    ],
)
def test_the_list_of_what_lacks_finds_it(field, lacks):
    assert set(lacking(field, True)) == lacks


def test_every_parameter_has_a_description_and_an_example(document):
    parameters = [
        (name, p) for name, operation in operations(document) for p in operation.get("parameters", [])
    ]
    assert {p["name"] for _, p in parameters} >= {"id", "If-None-Match", "format"}
    for name, parameter in parameters:
        assert parameter.get("description"), (name, parameter["name"])
        assert "example" in parameter or "examples" in parameter["schema"], (name, parameter["name"])


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


def test_the_documentation_needs_nothing_but_this_service(client):
    page = client.get("/docs")
    assert page.status_code == 200
    needed = re.findall(r"""(?:src|href|url)["']?\s*[=:]\s*["']([^"']+)""", page.text)
    assert "/openapi.json" in needed
    assert len(needed) >= 4
    for path in needed:
        assert path.startswith("/"), path
        assert client.get(path).status_code == 200, path
    assert '"validatorUrl": null' in page.text  # else the page would send the document to be judged
