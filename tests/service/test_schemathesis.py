"""Requests made from the OpenAPI document, right and wrong ones, against a running service."""

import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections import Counter
from contextlib import suppress
from pathlib import Path

import hypothesis
import pytest
import schemathesis
from schemathesis import GenerationMode
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    negative_data_rejection,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
    unsupported_method,
)

ROOT = Path(__file__).parents[2]
CHECKS = [
    status_code_conformance, content_type_conformance, response_headers_conformance,
    response_schema_conformance, negative_data_rejection, unsupported_method,
]  # fmt: skip
NAMED = {"audit-failed", "deadline-exceeded"}
"""The server's errors that a request on its own may bring about, by the contract."""


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    settings = {"DATA_DIR": tmp_path_factory.mktemp("data"), "PORT": port, "MAX_TIME_BUDGET": 2.0}
    server = subprocess.Popen(
        [sys.executable, "-m", "api.cli", "serve"],
        cwd=ROOT,
        env=os.environ | {f"WHEELPLAN_{name}": str(value) for name, value in settings.items()},
        stderr=subprocess.DEVNULL,
    )
    url = f"http://127.0.0.1:{port}"
    try:
        for _ in range(1200):
            try:
                urllib.request.urlopen(f"{url}/readyz")
                break
            except (OSError, urllib.error.HTTPError):
                assert server.poll() is None
                time.sleep(0.1)
        yield schemathesis.openapi.from_url(f"{url}/openapi.json")
    finally:
        server.terminate()
        server.wait(60)


SETTINGS = hypothesis.settings(
    max_examples=25, derandomize=True, deadline=None, database=None,
    suppress_health_check=list(hypothesis.HealthCheck), phases=[hypothesis.Phase.generate],
)  # fmt: skip


@pytest.mark.parametrize("mode", GenerationMode)
def test_every_answer_is_one_that_the_document_announces(described, mode):
    asked = Counter()

    def holds(case):
        answer = case.call()
        if answer.status_code >= 500:
            assert answer.json()["code"] in NAMED, answer.text
        # A batch is taken with its bad requests: each of them becomes a bad result.
        lenient = [negative_data_rejection] if case.path == "/v1/batches" else []
        case.validate_response(answer, checks=[check for check in CHECKS if check not in lenient])
        asked[case.method] += 1

    for found in described.get_all_operations():
        cases = found.ok().as_strategy(generation_mode=mode)
        with suppress(hypothesis.errors.Unsatisfiable):  # nothing about this operation can be wrong
            SETTINGS(hypothesis.given(cases)(holds))()
    assert asked["POST"] >= 100


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("/v1/plans", "PlanRequest"),
        ("/v1/kinematics/inverse", "InverseRequest"),
        ("/v1/kinematics/forward", "ForwardRequest"),
    ],
)
def test_the_answers_to_the_documents_examples_are_what_it_says(described, path, name):
    operation = described[path]["POST"]
    examples = described.raw_schema["components"]["schemas"][name]["examples"]
    assert examples
    for example in examples:
        answer = operation.Case(body=example, media_type="application/json").call_and_validate(checks=CHECKS)
        assert answer.status_code == 200


def test_a_maps_answers_are_what_the_document_says(described):
    yaml = b"{image: m, resolution: 0.5, origin: [0, 0, 0], occupied_thresh: 0.65, free_thresh: 0.2}"
    parts = {"yaml": yaml, "image": b"P5 2 2 255 \x00\xff\x80\xff"}
    upload = described["/v1/maps"]["POST"].Case(body=parts, media_type="multipart/form-data")
    made, again = upload.call_and_validate(checks=CHECKS), upload.call_and_validate(checks=CHECKS)
    assert (made.status_code, again.status_code) == (201, 200)
    named = {"id": made.json()["id"]}
    for path, method, status in (
        ("/v1/maps", "GET", 200), ("/v1/maps/{id}", "GET", 200), ("/v1/maps/{id}/image", "GET", 200),
        ("/v1/maps/{id}", "DELETE", 204), ("/v1/maps/{id}", "GET", 404),
    ):  # fmt: skip
        operation = described[path][method]
        case = operation.Case(path_parameters=named if "{id}" in path else {})
        assert case.call_and_validate(checks=CHECKS).status_code == status
