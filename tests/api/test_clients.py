"""Whose request it is."""

import pytest

from api.clients import client_of, known_by_token


def client(host):
    return client_of({"type": "http", "client": (host, 1234)})


def test_a_token_wins_over_the_address_and_is_not_shown():
    scopes = [{"client": (host, 1)} for host in ("192.0.2.1", "192.0.2.2")]
    for scope in scopes:
        known_by_token(scope, "secret")
    assert client_of(scopes[0]) == client_of(scopes[1])
    assert "secret" not in client_of(scopes[0])
    known_by_token(scopes[1], "other")
    assert client_of(scopes[0]) != client_of(scopes[1])


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("192.0.2.1", "192.0.2.1", True),
        ("192.0.2.1", "192.0.2.2", False),
        ("192.0.2.1", "::ffff:192.0.2.1", True),
        ("2001:db8:0:1::1", "2001:db8:0:1:ffff::2", True),
        ("2001:db8:0:1::1", "2001:db8:0:2::1", False),
        ("testclient", "testclient", True),
    ],
)
def test_addresses_of_one_host_are_one_client(one, other, same):
    assert (client(one) == client(other)) is same


def test_a_request_without_an_address_has_a_client_too():
    assert client_of({"type": "http", "client": None}) == client_of({"type": "http"}) == ""
