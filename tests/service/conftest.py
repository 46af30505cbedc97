import pytest

from tests.service.service import serving


@pytest.fixture(scope="session")
def server(tmp_path_factory):
    """A service of two workers with the settings that a new one has."""
    with serving(tmp_path_factory.mktemp("data"), workers=2) as server:
        yield server
