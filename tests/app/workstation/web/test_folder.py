"""No page can name a file outside of the folder that was opened."""

from __future__ import annotations

import os

import pytest

from layflat.app.support.errors import UsageError
from layflat.app.workstation.web.folder import MODEL, SESSION, Folder, foreign_policy
from layflat.tests.factories import make_episode, write_session

OUTSIDE = ("../secret.h5", "/etc/passwd", "sub/x.h5", "..", ".", "", ".hidden.h5", "a\0b.h5")


@pytest.fixture
def folder(tmp_path) -> Folder:
    inside = tmp_path / "runs"
    inside.mkdir()
    write_session(inside / "demos.h5", [make_episode(seed=1)])
    write_session(tmp_path / "secret.h5", [make_episode(seed=2)])
    (inside / "results").mkdir()
    (inside / "results" / "episodes.csv").touch()
    (inside / "model.npz").touch()
    return Folder(inside)


def test_the_files_of_the_folder_are_listed(folder):
    assert (folder.sessions(), folder.models(), folder.results()) == (["demos.h5"], ["model.npz"], ["results"])
    assert folder.session("demos.h5") == folder.path / "demos.h5"


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_name_that_leads_elsewhere_is_refused(folder, name):
    for find in (folder.session, folder.model, folder.result):
        with pytest.raises(UsageError, match="is not in"):
            find(name)


@pytest.mark.parametrize("name", [name for name in OUTSIDE if name])
def test_a_new_file_stays_in_the_folder(folder, name):
    with pytest.raises(UsageError, match="is not a name for a file here"):
        folder.new(name, SESSION)


def test_a_new_file_gets_its_suffix_once(folder):
    assert folder.new(" word ", MODEL).name == folder.new("word.npz", MODEL).name == "word.npz"


def test_a_file_that_vanishes_is_named(folder):
    (folder.path / "demos.h5").unlink()
    with pytest.raises(UsageError, match=r"demos.h5 is not in .* any more; choose another one"):
        folder.session("demos.h5")


@pytest.mark.skipif(os.geteuid() == 0, reason="root can write everywhere")
def test_a_read_only_folder_can_be_looked_at(folder):
    folder.path.chmod(0o555)
    try:
        assert folder.read_only
        assert folder.session("demos.h5").exists()
        with pytest.raises(UsageError, match="can only be looked at"):
            folder.new("x", SESSION)
    finally:
        folder.path.chmod(0o755)


@pytest.mark.parametrize("text", ["package.module:factory", "ws://127.0.0.1:8000?replan=2", "m:Policy+recovery"])
def test_a_policy_of_ones_own_is_known_by_its_form(text):
    assert foreign_policy(f" {text} ") == text


@pytest.mark.parametrize(
    "text", ["", "model.npz", "../m.npz", "/etc/passwd", "~/x", "a=b:c", "scripted", "file:///etc"]
)
def test_no_file_can_be_named_as_a_policy(text):
    with pytest.raises(UsageError, match="is not package"):
        foreign_policy(text)
