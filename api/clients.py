"""Whose request it is: the bearer token's, where the service asks for tokens, else the peer address's."""

from __future__ import annotations

import hashlib
from ipaddress import IPv6Address, ip_address

from starlette.types import Scope

__all__ = ["client_of", "known_by_token"]

_KEY = "wheelplan.client"
_SITE = 64
"""An IPv6 client may use all addresses with the same first bits."""


def known_by_token(scope: Scope, token: str) -> None:
    """From now on the request is its token's, which is valid."""
    scope[_KEY] = "token " + hashlib.sha256(token.encode("latin-1")).hexdigest()[:16]


def client_of(scope: Scope) -> str:
    """A name for the client of a request, the same for all of its requests. It says nothing of its token."""
    if _KEY in scope:
        return str(scope[_KEY])
    host = str((scope.get("client") or ("", 0))[0])
    try:
        address = ip_address(host)
    except ValueError:
        return host
    if not isinstance(address, IPv6Address):
        return host
    if address.ipv4_mapped is not None:
        return str(address.ipv4_mapped)
    return str(IPv6Address(int(address) >> (128 - _SITE) << (128 - _SITE)))
