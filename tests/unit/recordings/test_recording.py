import datetime

import pytest

from socialiq.audit.profile.profile import Margin
from socialiq.audit.profile.reader import parse
from socialiq.audit.profile.template import declare
from socialiq.cli.main import main
from socialiq.demonstrations import files
from socialiq.errors import UserError
from socialiq.worlds.files import refuse_file

REASON = "its neighbours do not react"


@pytest.mark.parametrize("world", ["junction.safetensors", "a/b.XML", "07_tracks.csv"])
def test_a_recording_is_no_world(world):
    with pytest.raises(UserError, match=REASON):
        refuse_file(world)


def test_worlds_are_worlds():
    for world in ("crossing7", "intersection", "socialiq/Intersection-v1", "CartPole-v1"):
        assert refuse_file(world) is None


@pytest.mark.parametrize(
    "arguments",
    [
        ["evaluate", "go", "--world", "r.safetensors", "--episodes", "5"],
        ["train", "iq-learn", "mixed.safetensors", "--world", "r.safetensors", "--out", "run"],
        ["profile", "new", "--world", "r.safetensors", "--angle", "45"],
    ],
)
def test_commands_refuse_it_in_one_line(arguments, human_table, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("mixed", "r"):
        files.save(tmp_path / f"{name}.safetensors", human_table)
    assert main(arguments) == 2
    out, error = capsys.readouterr()
    assert out == "" and error.count("\n") == 1 and REASON in error


def declared_world(name: str) -> bytes:
    """Return a declaration whose world has another name."""
    made = declare(
        45.0, "Example Cars", "intersection", Margin(1.0, 10.0), datetime.date(2026, 1, 31)
    )
    changed = made.source.decode().replace('world = "intersection"', f'world = "{name}"')
    assert changed != made.source.decode()
    return changed.encode()


def test_a_profile_that_names_one_says_why():
    with pytest.raises(UserError, match=REASON) as caught:
        parse(declared_world("r.csv"))
    assert "profile.toml:" in str(caught.value)


def test_an_audit_of_a_profile_that_names_one_says_why(human_table, capsys, tmp_path, monkeypatch):
    """A file of this format may be a recorded junction, so it is read."""
    monkeypatch.chdir(tmp_path)
    files.save(tmp_path / "r.safetensors", human_table)
    (tmp_path / "profile.toml").write_bytes(declared_world("r.safetensors"))
    words = ["audit", "idm", "--profile", "profile.toml", "--episodes", "20", "--out", "a"]
    assert main(words) == 2
    out, error = capsys.readouterr()
    assert out == "" and error.count("\n") == 1 and REASON in error
    assert not (tmp_path / "a").exists()
