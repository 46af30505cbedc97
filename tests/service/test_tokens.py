"""Bearer tokens: who is let in, and how they are changed in service."""

import json
import os
import re
import subprocess
import sys

import pytest

from tests.service.service import QUICK, ROOT, serving, until


@pytest.fixture(scope="module")
def tokens(tmp_path_factory):
    file = tmp_path_factory.mktemp("secrets") / "tokens"
    file.write_text("# for rotation\nold-token\n\n  new-token  \n")
    return file


@pytest.fixture(scope="module")
def guarded(tmp_path_factory, tokens):
    data_dir = tmp_path_factory.mktemp("data")
    with serving(data_dir, "old-token", workers=1, tokens_file=tokens) as server:
        yield server


@pytest.mark.parametrize("token", ["old-token", "new-token"])
def test_every_token_in_the_file_lets_in(guarded, token):
    assert guarded.call("/v1/plans", QUICK, Authorization=f"Bearer {token}")[0] == 200
    assert guarded.call("/v1/drives", Authorization=f"bearer  {token}")[0] == 200


@pytest.mark.parametrize(
    "sent",
    [
        None, "", "Bearer", "Bearer ", "Bearer wrong", "Bearer old-toke", "Bearer old-token2",
        "Bearer OLD-TOKEN", "Basic old-token", "old-token", "Bearer # for rotation", "Bearer \xe9",
    ],
)  # fmt: skip
@pytest.mark.parametrize("path", ["/v1/plans", "/v1/drives", "/metrics", "/v1/limits", "/nowhere"])
def test_nobody_else_is_let_in(guarded, sent, path):
    status, headers, body = guarded.call(path, **({} if sent is None else {"Authorization": sent}))
    assert (status, json.loads(body)["code"]) == (401, "unauthorized")
    assert headers["www-authenticate"].startswith('Bearer realm="wheelplan"')
    assert headers["x-request-id"]


@pytest.mark.parametrize("path", ["/livez", "/readyz"])
def test_probes_of_health_need_no_token(guarded, path):
    assert guarded.call(path)[0] == 200


@pytest.mark.parametrize("path", ["/", "/static/main.js", "/docs", "/openapi.json"])
def test_what_a_browser_loads_without_a_token_is_open_and_so_are_the_files_that_it_names(guarded, path):
    status, _, body = guarded.call(path)
    assert status == 200
    for needed in set(re.findall(r"""(?:src|href)="(/[^"]+)""", body.decode())):
        assert guarded.call(needed)[0] == 200, needed


def test_the_openapi_document_tells_which_routes_ask_for_a_token(guarded):
    document = json.loads(guarded.call("/openapi.json")[2])
    ((name, scheme),) = document["components"]["securitySchemes"].items()
    assert (scheme["type"], scheme["scheme"]) == ("http", "bearer")
    for path, methods in document["paths"].items():
        asks = guarded.call(path)[0] == 401
        for operation in methods.values():
            assert operation.get("security") == ([{name: []}] if asks else None), path


def test_a_token_is_added_and_withdrawn_without_a_restart(guarded, tokens):
    def let_in(token):
        return guarded.call("/v1/drives", Authorization=f"Bearer {token}")[0] == 200

    before = tokens.read_text()
    changed = tokens.with_suffix(".next")
    changed.write_text("third-token\n")
    os.replace(changed, tokens)
    assert let_in("third-token")
    assert not let_in("old-token")
    tokens.unlink()
    assert let_in("third-token")
    assert not let_in("old-token")
    tokens.write_text("")
    assert not let_in("third-token")
    tokens.write_text(before)
    assert let_in("old-token")
    until(lambda: any(b"cannot be read" in line for line in guarded.log), 5)
    assert not any(b"-token" in line for line in guarded.log)


@pytest.mark.parametrize("content", [None, "", "# none\n\n"])
def test_a_service_that_should_ask_for_tokens_does_not_start_without_any(tmp_path, content):
    file = tmp_path / "tokens"
    if content is not None:
        file.write_text(content)
    env = os.environ | {"WHEELPLAN_TOKENS_FILE": str(file), "WHEELPLAN_DATA_DIR": str(tmp_path)}
    command = [sys.executable, "-m", "api.cli", "serve", "--port", "0"]
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, timeout=60)
    assert done.returncode == 2
    assert str(file).encode() in done.stderr
