"""`view` before it serves."""

import sys

import pytest

from socialiq.cli.main import main
from socialiq.errors import UserError
from socialiq.view.server import bound


def test_without_the_extra_one_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    assert main(["view", "idm", "--no-open"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "pip install 'socialiq[web]'" in said


def test_a_port_is_one_that_a_user_may_have():
    for port in (-1, 80, 65536):
        with pytest.raises(UserError, match="from 1024 to 65535"):
            bound(port)


def test_it_listens_on_this_machine_alone_and_says_so_if_the_port_is_taken():
    with bound(0) as listening:
        address, port = listening.getsockname()
        assert address == "127.0.0.1"
        with pytest.raises(UserError, match=rf"cannot listen at 127\.0\.0\.1:{port}"):
            bound(port)
