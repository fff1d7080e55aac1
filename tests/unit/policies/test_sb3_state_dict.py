import os
import pickle
import struct

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.policies.sb3_tensors import MOST_OPCODES, read_state_dict

ARRAYS = {
    "w": np.arange(6, dtype=np.float32).reshape(2, 3),
    "b": np.array([-1.5, 2.5], np.float32),
    "s": np.array(4.0, np.float32),
}


def refused(content, match):
    with pytest.raises(UserError, match=match) as caught:
        read_state_dict(content, "policy.pth")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


def test_arrays_are_read(crafted):
    found = read_state_dict(crafted.pth(ARRAYS), "policy.pth")
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == np.float32


def test_tensor_may_be_a_part_of_its_storage(crafted):
    said = crafted.tensor(crafted.storage("0", 6), (2,), offset=4)
    content = {"a/data.pkl": crafted.program({"b": said})}
    content["a/data/0"] = ARRAYS["w"].tobytes()
    np.testing.assert_array_equal(
        read_state_dict(crafted.zipped(content), "policy.pth")["b"], [4.0, 5.0]
    )


class Touch:
    """A pickle that makes a file when it is loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (open, (str(self.path), "w"))


@pytest.mark.parametrize("protocol", range(6))
def test_pickle_that_would_act_does_nothing(crafted, tmp_path, protocol):
    target = tmp_path / "touched"
    program = pickle.dumps({"w": Touch(target)}, protocol)
    refused(crafted.zipped({"a/data.pkl": program}), "holds more than tensors")
    assert not target.exists()
    pickle.loads(program)["w"].close()  # the fixture is what it claims to be
    assert target.exists()


@pytest.mark.parametrize(
    "said",
    [
        b"cos\nsystem\n(X\x04\x00\x00\x00trueetR",
        b"c__builtin__\neval\n(X\x01\x00\x00\x001tR",
        b"(ios\nsystem\n",
        b"(cos\nsystem\nX\x04\x00\x00\x00trueo",
        b"ctorch._utils\n_rebuild_parameter\n",
        b"ctorch.storage\n_load_from_bytes\n",
        b"ccollections\nOrderedDict\n(X\x01\x00\x00\x001tR",  # with arguments
        b"ctorch\nFloatStorage\n)R",
        b"\x82\x01",  # EXT1: a registered extension
        b"(I1\nt",
    ],
)
def test_everything_else_that_a_pickle_can_say_is_refused(crafted, said):
    content = crafted.zipped({"a/data.pkl": crafted.program({"w": said})})
    refused(content, "holds more than tensors")


def test_system_is_not_even_imported(crafted, monkeypatch):
    monkeypatch.setattr(os, "system", lambda _: pytest.fail("called"))
    said = b"cos\nsystem\n(" + crafted.word("true") + b"tR"
    refused(crafted.zipped({"a/data.pkl": crafted.program({"w": said})}), "the name os system")


def one_tensor(crafted, said, raw=bytes(24)):
    return crafted.zipped({"a/data.pkl": crafted.program({"w": said}), "a/data/0": raw})


def test_faults_of_tensors_are_refused(crafted):
    def case(shape, match, **other):
        refused(one_tensor(crafted, crafted.tensor(crafted.storage("0", 6), shape, **other)), match)

    case((2, 4), "larger than its bytes")
    case((2, 3), "larger than its bytes", offset=1)
    case((2, 3), "row by row", strides=(1, 2))
    case((2, 3), "row by row", strides=(3,))
    case((-2, -3), "shape is not integers")
    case((6,), "shape is not integers", offset=-1)
    case((1, 2, 3), "a tensor of shape")
    case((2**31 - 1, 2**31 - 1), "a tensor of shape")
    case((16_384, 16_384), "more than 16,777,216 bytes")


def test_faults_of_storages_are_refused(crafted):
    def case(stored, match):
        refused(one_tensor(crafted, crafted.tensor(stored, (2, 3))), match)

    case(crafted.storage("0", 7), "larger than its bytes|more than 28 bytes")
    case(crafted.storage("0", 5), "more than 20 bytes")
    case(crafted.storage("1", 6), "has no member")
    case(crafted.storage("../0", 6), "without a place")
    case(crafted.storage("0", -1), "without a place")
    case(crafted.storage("0", 6, b"ctorch\nDoubleStorage\n"), "torch DoubleStorage")
    case(crafted.word("0"), "without a storage")
    case(crafted.storage("0", 2**30), "more than 16,777,216 bytes")


def test_many_tensors_on_one_storage_cost_nothing(crafted):
    raw = bytes(4_000_000)
    stored = crafted.storage("0", 1_000_000)
    many = {f"w{n}": crafted.tensor(stored, (1_000, 1_000)) for n in range(400)}
    content = crafted.zipped({"a/data.pkl": crafted.program(many), "a/data/0": raw})
    with crafted.bounded(20_000_000):
        refused(content, "more than 16,777,216 bytes")


@pytest.mark.parametrize("cut", [0, 1, 2, 10, 40, -1])
def test_truncated_program_is_refused(crafted, cut):
    whole = crafted.program({"w": crafted.tensor(crafted.storage("0", 6), (2, 3))})
    refused(crafted.zipped({"a/data.pkl": whole[:cut]}), "damaged data.pkl")


@pytest.mark.parametrize(
    "program", [b"\x80\x02.", b"\x80\x02t.", b"\x80\x02R.", b"\x80\x02u.", b"\x80\x02h\x07."]
)
def test_program_that_underruns_its_stack_is_refused(crafted, program):
    refused(crafted.zipped({"a/data.pkl": program}), "damaged data.pkl")


@pytest.mark.parametrize(
    "program",
    [
        b"\x80\x02)" + b"(" * 200_000 + b".",
        b"\x80\x02)" + b"q\x00h\x00h\x00\x86" * 60_000 + b".",
        b"\x80\x02" + b"N" * 500_000 + b".",
    ],
)
def test_long_programs_are_not_read_to_their_end(crafted, as_a_user_runs_it, program):
    with crafted.bounded(20_000_000):
        refused(crafted.zipped({"a/data.pkl": program}), f"more than {MOST_OPCODES} opcodes")


def test_other_things_than_a_dictionary_of_tensors_are_refused(crafted):
    empty = crafted.zipped({"a/data.pkl": b"\x80\x02).", "a/data/0": b""})
    refused(empty, "other than a dictionary")
    refused(crafted.zipped({"a/data.pkl": crafted.program({"w": b"N"})}), "w is not a tensor")
    twice = b"\x80\x02}(" + (crafted.word("w") + b"N") * 2 + b"u."
    refused(crafted.zipped({"a/data.pkl": twice}), "occurs twice")
    refused(crafted.zipped({"a/data.pkl": b"\x80\x02}(NNu."}), "a name that is not text")
    refused(crafted.zipped({"a/data.pkl": b"\x80\x02}}b."}), "other than _metadata")


def test_name_that_is_a_script_is_told_on_one_line(crafted):
    name = "<script>\x1b[2J\n" + "x" * 500
    refused(crafted.zipped({"a/data.pkl": crafted.program({name: b"N"})}), "is not a tensor")


def test_program_must_be_there_once(crafted):
    refused(crafted.zipped({"data.pkl": b""}), "no single data.pkl")
    refused(crafted.zipped({"a/data.pkl": b"", "b/data.pkl": b""}), "no single data.pkl")


def test_other_order_of_bytes_is_refused(crafted):
    refused(crafted.pth(ARRAYS, **{"archive/byteorder": b"big"}), "big-endian")


def test_huge_program_is_not_read(crafted):
    content = crafted.zipped({"a/data.pkl": bytes(1024 * 1024 + 1)})
    refused(content, "more than 1,048,576 bytes")


def test_length_words_beyond_the_program_are_damage(crafted):
    said = b"X" + struct.pack("<I", 2**32 - 1)
    refused(crafted.zipped({"a/data.pkl": b"\x80\x02" + said + b"."}), "damaged data.pkl")


def test_older_torch_names_its_storages_by_long_numbers(crafted):
    """Addresses in memory, before torch 1.13."""
    place = "94185873392848"
    program = crafted.program({"x": crafted.tensor(crafted.storage(place, 2), (2,))})
    members = {"archive/data.pkl": program, f"archive/data/{place}": np.ones(2, "<f4").tobytes()}
    assert read_state_dict(crafted.zipped(members), "p.pth")["x"].tolist() == [1.0, 1.0]


def test_oldest_format_of_torch_is_named():
    with pytest.raises(UserError, match=r"of torch before 1\.6: load the policy and save it again"):
        read_state_dict(b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19.", "p.pth")
