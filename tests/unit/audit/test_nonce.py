"""The file of a nonce."""

import hashlib
import json
import os
import stat

import pytest

from socialiq.audit.seeds import Nonce, read_nonce, write_nonce
from socialiq.errors import UserError


def test_a_nonce_is_new_secret_and_read_back(tmp_path):
    one, two = (write_nonce(tmp_path / name) for name in ("one.json", "two.json"))
    assert one != two and read_nonce(tmp_path / "one.json") == one
    assert stat.S_IMODE((tmp_path / "one.json").stat().st_mode) == 0o600
    assert one.sha256 == hashlib.sha256(bytes.fromhex(one.value)).hexdigest()
    assert Nonce("00" * 32).sha256.startswith("66687aadf862bd77")  # of 32 zero bytes


def test_a_nonce_is_not_overwritten(tmp_path):
    path = tmp_path / "nonce.json"
    nonce = write_nonce(path)
    with pytest.raises(UserError, match="a nonce is used once; name a new file"):
        write_nonce(path)
    assert read_nonce(path) == nonce
    with pytest.raises(UserError, match="cannot write"):
        write_nonce(tmp_path / "none" / "nonce.json")


@pytest.mark.parametrize("content", ["", "[]", "7", '{"nonce": 7}', '{"nonce": "AB"}', "{}"])
def test_what_is_no_nonce_is_refused(tmp_path, content):
    path = tmp_path / "nonce.json"
    path.write_text(content)
    with pytest.raises(UserError, match=r"no nonce|cannot read"):
        read_nonce(path)


def test_a_pipe_and_a_large_file_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UserError, match="not a regular file"):
        read_nonce(tmp_path / "pipe")
    (tmp_path / "large").write_text(json.dumps({"nonce": "0" * 100_000}))
    with pytest.raises(UserError, match="is larger than"):
        read_nonce(tmp_path / "large")
