"""The files of the page, as any client gets them."""

import re
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from api.app import create_app
from api.settings import Settings
from api.workers import Pool

STATIC = Path(__file__).parents[2] / "api" / "static"


class NoPool(Pool):
    def start(self) -> None:
        pass


@pytest.fixture
def client(tmp_path):
    with TestClient(create_app(Settings(data_dir=tmp_path), NoPool(1, 1))) as client:
        yield client


def test_the_page_is_at_the_root_under_a_strict_policy(client):
    answer = client.get("/")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    policy = answer.headers["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "unsafe" not in policy


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("main.js", "text/javascript"), ("page.css", "text/css"), ("icon.svg", "image/svg+xml"),
        ("inter.woff2", "font/woff2"),
    ],
)  # fmt: skip
def test_each_file_has_its_type_and_is_sent_again_only_when_it_has_changed(client, name, kind):
    answer = client.get(f"/static/{name}")
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith(kind)
    assert answer.content == (STATIC / name).read_bytes()
    assert answer.headers["cache-control"] == "no-cache"
    again = client.get(f"/static/{name}", headers={"if-none-match": answer.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert "content-security-policy" in again.headers


@pytest.mark.parametrize("name", ["nothing.js", "..%2fapp.py", "%2e%2e/app.py", "%2e%2e", "."])
def test_nothing_else_is_served(client, name):
    answer = client.get(f"/static/{name}")
    assert answer.status_code == 404
    assert answer.json()["code"] == "not-found"


def test_every_file_that_the_page_names_is_there():
    for file in STATIC.glob("*.*"):
        if file.suffix in (".html", ".js", ".css"):
            text = file.read_text()
            for name in re.findall(r'"/static/([^"]+)"', text) + re.findall(r'from "\./([^"]+)"', text):
                assert (STATIC / name).is_file(), f"{file.name} names {name}"


def test_every_module_is_short_enough_to_read():
    for file in STATIC.glob("*.*"):
        if file.suffix in (".js", ".css", ".html"):
            assert len(file.read_text().splitlines()) <= 400, file.name
