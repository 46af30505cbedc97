"""Where libraries write, when the place they are told is read-only."""

import os
import tempfile

import pytest

from api.places import keep_to


@pytest.fixture(autouse=True)
def _restored(monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", tempfile.tempdir)
    for variable in ("TMPDIR", "MPLCONFIGDIR"):
        monkeypatch.setenv(variable, "/nonexistent")  # so that all are put back
        monkeypatch.delenv(variable)


def read_only(monkeypatch, *folders):
    # Nothing is read-only to root but a file system mounted so.
    access = os.access
    named = {str(folder) for folder in folders}
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) not in named and access(path, mode))


def test_temporary_files_go_to_the_data_folder_where_theirs_is_read_only(monkeypatch, tmp_path):
    (place := tmp_path / "tmp").mkdir()
    monkeypatch.setenv("TMPDIR", str(place))
    read_only(monkeypatch, place)
    keep_to(tmp_path / "data")
    assert tempfile.gettempdir() == str(tmp_path / "data/cache/tmp")


def test_what_can_be_written_to_or_made_stays(monkeypatch, tmp_path):
    monkeypatch.setenv("MPLCONFIGDIR", str(tmp_path / "to/be/made"))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    keep_to(tmp_path / "data")
    assert os.environ["MPLCONFIGDIR"] == str(tmp_path / "to/be/made")
    assert os.environ["TMPDIR"] == str(tmp_path)
    assert not (tmp_path / "data").exists()
