"""Which media type a client gets (RFC 9110, section 12.5.1)."""

from __future__ import annotations

from collections.abc import Sequence

from api.errors import Refusal

__all__ = ["accepts_gzip", "choose"]


def choose(accept: str | None, offers: Sequence[str]) -> str:
    """The offer that an Accept header likes best, the first of equals. Raises Refusal: not-acceptable."""
    if not (accept or "").strip():
        return offers[0]
    ranges = _weighted(accept or "")
    best = max(offers, key=lambda offer: _quality(offer, ranges))
    if _quality(best, ranges) <= 0:
        raise Refusal("not-acceptable", f"This resource is offered as {', '.join(offers)}.")
    return best


def accepts_gzip(accept_encoding: str | None) -> bool:
    """Whether an Accept-Encoding header allows gzip by name."""
    return dict(_weighted(accept_encoding or "")).get("gzip", 0.0) > 0


def _weighted(header: str) -> list[tuple[str, float]]:
    found = []
    for item in header.split(","):
        name, *parameters = (part.strip().lower() for part in item.split(";"))
        quality = 1.0
        for parameter in parameters:
            if parameter.startswith("q="):
                try:
                    quality = float(parameter[2:])
                except ValueError:
                    quality = 0.0
        if name:
            found.append((name, quality))
    return found


def _quality(offer: str, ranges: list[tuple[str, float]]) -> float:
    # The most specific range that matches decides.
    for pattern in (offer, offer.split("/")[0] + "/*", "*/*"):
        for name, quality in ranges:
            if name == pattern:
                return quality
    return 0.0
