"""Traces, as an OpenTelemetry collector gets them from a real service."""

import json
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest

from tests.service.service import QUICK, ROOT, serving, slow, until


@pytest.fixture
def collector():
    """(its address, the spans it has got)."""
    spans = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            body = self.rfile.read(int(self.headers["Content-Length"]))
            for resource in ExportTraceServiceRequest.FromString(body).resource_spans:
                for scope in resource.scope_spans:
                    spans.extend(scope.spans)
            self.send_response(200)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}", spans
    server.shutdown()


def test_a_trace_says_how_long_a_plan_has_waited_and_taken(tmp_path, collector, monkeypatch):
    address, spans = collector
    monkeypatch.setenv("OTEL_EXPORTER_OTLP_ENDPOINT", address)
    monkeypatch.setenv("OTEL_BSP_SCHEDULE_DELAY", "100")
    trace, parent = "0123456789abcdef" * 2, "fedcba9876543210"
    with serving(tmp_path, workers=1) as server:
        _, headers, body = server.call("/v1/plans", slow(0.5), traceparent=f"00-{trace}-{parent}-01")
        assert json.loads(body)["duration"] > 0
        assert server.plan({**QUICK, "robot": {}})[0] == 422
        until(lambda: len(spans) >= 4, 20)
    ours = {span.name: span for span in spans if span.trace_id.hex() == trace}
    assert set(ours) == {"POST /v1/plans", "queue", "plan"}
    request = ours["POST /v1/plans"]
    assert request.parent_span_id.hex() == parent
    assert {ours[name].parent_span_id for name in ("queue", "plan")} == {request.span_id}
    attributes = {a.key: a.value.string_value or a.value.int_value for a in request.attributes}
    assert attributes["http.response.status_code"] == 200
    assert attributes["wheelplan.request_id"] == headers["x-request-id"]
    seconds = {
        name: (span.end_time_unix_nano - span.start_time_unix_nano) * 1e-9 for name, span in ours.items()
    }
    assert seconds["queue"] < 0.4 < seconds["plan"] < seconds["POST /v1/plans"]
    assert {span.name for span in spans} == {"POST /v1/plans", "queue", "plan"}  # no probes


def test_without_an_endpoint_nothing_of_the_sdk_is_loaded():
    code = (
        "import sys; from starlette.testclient import TestClient; from api.app import create_app\n"
        "from api.settings import Settings; from api.workers import Pool; Pool.start = lambda self: None\n"
        "with TestClient(create_app(Settings())) as client: client.get('/v1/drives')\n"
        "assert not [name for name in sys.modules if name.startswith('opentelemetry.sdk')]"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, timeout=60)
