"""Attack: a nonce that a report has published is named by another owner, who knows it by now."""

import datetime
import json

import pytest

from socialiq.audit.look import Plan, commit, of_nonce, open_look
from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.template import declare
from socialiq.audit.seeds import Commitment, read_nonce, write_nonce
from socialiq.errors import UserError


def plan(owner):
    day = datetime.date(2026, 1, 31)
    profile = declare(45.0, owner, "crossing5", Margin(1.0, 10.0), day)
    return Plan(Commitment("ab" * 32, profile.sha256), profile, 100, False, ())


@pytest.fixture
def revealed(tmp_path):
    """The auditor's file of a nonce that was revealed for the first owner."""
    path = tmp_path / "nonce.json"
    told = of_nonce(write_nonce(path).sha256)
    commit(tmp_path / "first", plan("First"), told)
    open_look(tmp_path / "first", plan("First"), read_nonce(path))
    return path


def test_it_is_refused_in_another_log(tmp_path, revealed):
    commit(tmp_path / "second", plan("Second"), of_nonce(read_nonce(revealed).sha256))
    with pytest.raises(UserError, match="revealed for another commitment"):
        open_look(tmp_path / "second", plan("Second"), read_nonce(revealed))


def test_it_is_refused_in_the_same_folder(tmp_path, revealed):
    with pytest.raises(UserError, match="names this nonce already"):
        commit(tmp_path / "first", plan("Second"), of_nonce(read_nonce(revealed).sha256))


def test_a_copy_of_it_is_not_the_auditors(tmp_path, revealed):
    """The second owner writes the nonce into a file; the auditor's says for whom it was."""
    copied = tmp_path / "copied.json"
    copied.write_text(json.dumps({"nonce": read_nonce(revealed).value}))
    look = commit(tmp_path / "second", plan("Second"), of_nonce(read_nonce(copied).sha256))
    open_look(tmp_path / "second", plan("Second"), read_nonce(copied))
    assert json.loads(revealed.read_text())["commitment"] != look.entry
