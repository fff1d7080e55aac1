"""Files with random bytes changed are read or refused; nothing else may happen."""

import io
import zipfile

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq.policies.interface import Interface
from socialiq.policies.onnx_load import check_fields
from socialiq.policies.sb3_load import read_sb3
from socialiq.policies.sb3_tensors import Archive, read_state_dict

TRIALS = 400


def members(content):
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def changed(content, seed):
    """The same with one to four bytes replaced, removed or doubled."""
    random, made = np.random.default_rng(seed), bytearray(content)
    for _ in range(random.integers(1, 5)):
        place = int(random.integers(len(made)))
        made[place : place + 1] = random.bytes(1) * int(random.integers(0, 3))
    return bytes(made)


def outcomes(read, content):
    """Numbers of trials that were read, and refused."""
    refused = 0
    for seed in range(TRIALS):
        try:
            read(changed(content, seed))
        except UserError as error:
            refused += 1
            assert "\n" not in str(error)
    return TRIALS - refused, refused


@pytest.fixture(scope="module")
def example(crafted):
    return (crafted.examples / "dqn_intersection.zip").read_bytes()


def test_torchs_pickle(crafted, example):
    inner = members(members(example)["policy.pth"])
    name = next(one for one in inner if one.endswith("data.pkl"))

    def read(program):
        read_state_dict(crafted.zipped(inner | {name: program}), "policy.pth")

    good, refused = outcomes(read, inner[name])
    assert good and refused


def test_words_of_stable_baselines(crafted, example):
    outer = members(example)

    def read(said):
        read_sb3(crafted.zipped(outer | {"data": said}), "some.zip", Interface(70, 3))

    good, refused = outcomes(read, outer["data"])
    assert good and refused


def test_directory_of_the_archive(example):
    small = example[-700:]  # the directory; what it points to is gone

    def read(content):
        archive = Archive(content, "some.zip")
        for name in archive.names:
            archive.read(name, 10**6)

    assert outcomes(read, small)[1] == TRIALS


def test_fields_of_onnx(crafted):
    content = (crafted.examples / "dqn_intersection.onnx").read_bytes()
    good, refused = outcomes(lambda one: check_fields(one, "some.onnx"), content)
    assert good and refused
