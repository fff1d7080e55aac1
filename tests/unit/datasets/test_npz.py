"""Archives of others: numbers are read, nothing is unpickled, no header is believed."""

import io
import os
import tracemalloc
import zipfile
from typing import Any

import numpy as np
import pytest
from numpy.lib import format as npy

from socialiq.datasets.step_files import read_npz
from socialiq.errors import UserError


class Touches:
    """Makes a folder where it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (self.path,)


def member(shape, descr: Any = "<f8", content=b"", version=(1, 0)):
    file = io.BytesIO()
    header = {"descr": descr, "fortran_order": False, "shape": shape}
    (npy.write_array_header_1_0 if version == (1, 0) else npy.write_array_header_2_0)(file, header)
    return file.getvalue() + content


def archive(path, **members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return path


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_come_back(tmp_path, save):
    arrays = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.array([True]),
        "c": np.array([3], np.int16),
    }
    save(tmp_path / "x.npz", **arrays, d=np.zeros((2, 2), np.float32).T)
    found = read_npz(tmp_path / "x.npz", ("a", "b", "c", "d", "missing"))
    assert list(found) == ["a", "b", "c", "d"]
    for name, array in arrays.items():
        assert found[name].dtype == array.dtype and np.array_equal(found[name], array)


def test_pickles_are_never_loaded(tmp_path):
    trap = tmp_path / "touched"
    infos = np.array([Touches(str(trap))], object)
    np.savez(tmp_path / "x.npz", obs=np.zeros(2), infos=infos)
    assert list(read_npz(tmp_path / "x.npz", ("obs",))) == ["obs"]
    with pytest.raises(UserError, match="infos is 'O', not an array of numbers"):
        read_npz(tmp_path / "x.npz", ("obs", "infos"))
    assert not trap.exists()
    np.load(tmp_path / "x.npz", allow_pickle=True)["infos"]
    assert trap.exists()  # the trap is one


def test_huge_shapes_cost_nothing(tmp_path):
    tracemalloc.start()
    for shape in ((2**50,), (2**31, 2**31), (10**9, 1)):
        path = archive(tmp_path / "x.npz", a=member(shape, content=b"\0" * 64))
        with pytest.raises(UserError, match="has another size than its header"):
            read_npz(path, ("a",))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5_000_000


def test_bombs_are_refused_by_what_they_unpack_to(tmp_path, monkeypatch):
    from socialiq.datasets import step_files as npz

    monkeypatch.setattr(npz, "MOST_BYTES", 10_000)
    path = archive(tmp_path / "x.npz", a=member((4_000,), content=b"\0" * 32_000))
    assert path.stat().st_size < 1_000
    with pytest.raises(UserError, match="holds more than 10,000 bytes"):
        read_npz(path, ("a",))


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no array",
        member((2,), content=b"\0" * 15),
        member((-1,), content=b"\0" * 8),
        member((2,), "<c16", b"\0" * 32),
        member((2,), "<U3", b"\0" * 24),
        member((2,), [("x", "<f8")], b"\0" * 16),
        member((1,), "|O", b"\x80\x04N."),
        member((2,), content=b"\0" * 16).replace(b"shape", b"shap["),
        member((2,), content=b"\0" * 16)[:40],
        b"\x93NUMPY\x09\x00" + b"\0" * 100,
    ],
)
def test_crafted_members_are_refused(tmp_path, content):
    with pytest.raises(UserError) as caught:
        read_npz(archive(tmp_path / "x.npz", a=content), ("a",))
    assert "\n" not in str(caught.value)


def test_damaged_archives_are_refused(tmp_path):
    np.savez_compressed(tmp_path / "x.npz", a=np.random.default_rng(0).normal(size=1000))
    whole = (tmp_path / "x.npz").read_bytes()
    for content in (b"", whole[:-1], whole[: len(whole) // 2], b"\0" * 100, b"PK\x03\x04"):
        (tmp_path / "y.npz").write_bytes(content)
        with pytest.raises(UserError, match=r"damaged or no \.npz archive"):
            read_npz(tmp_path / "y.npz", ("a",))
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 1
    (tmp_path / "y.npz").write_bytes(flipped)
    with pytest.raises(UserError, match="damaged"):
        read_npz(tmp_path / "y.npz", ("a",))
    with pytest.raises(UserError, match="no such file"):
        read_npz(tmp_path / "none.npz", ("a",))
