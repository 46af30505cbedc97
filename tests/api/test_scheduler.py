"""Which scheduler the settings choose."""

import sys
from dataclasses import replace

import pytest

from api.app import scheduler_of
from api.workers import Pool


def test_the_local_pool_is_the_default(settings):
    pool = scheduler_of(replace(settings, workers=3, queue_length=7))
    assert isinstance(pool, Pool)
    assert (pool.size, pool.queue_length) == (3, 7)


def test_an_address_chooses_a_cluster(settings):
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    cluster = scheduler_of(replace(settings, scheduler="tcp://127.0.0.1:1", queue_length=7))
    assert cluster.queue_length == 7
    assert not cluster.ready


def test_what_is_no_address_is_refused_at_the_start(settings):
    with pytest.raises(ValueError, match="WHEELPLAN_SCHEDULER must be an address like tcp://"):
        scheduler_of(replace(settings, scheduler="localhost"))


def test_a_cluster_without_its_extra_says_what_is_missing(settings, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    for module in ("api.cluster", "api.supervisor"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    with pytest.raises(ValueError, match=r"wheelplan\[cluster\]"):
        scheduler_of(replace(settings, scheduler="tcp://127.0.0.1:1"))
