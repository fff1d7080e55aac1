import io
import struct
import warnings
import zipfile

import pytest

from socialiq.errors import UserError
from socialiq.policies.sb3_tensors import MOST_MEMBERS, Archive


def refused(content, match):
    with pytest.raises(UserError, match=match) as caught:
        Archive(content, "some.zip").read("data", 1_000)
    assert str(caught.value).startswith("some.zip") and "\n" not in str(caught.value)


@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_member_is_read(crafted, compression):
    archive = Archive(crafted.zipped({"data": b"x" * 1_000, "b": b""}, compression), "some.zip")
    assert archive.names == ("data", "b")
    assert archive.read("data", 1_000) == b"x" * 1_000


def test_missing_member_is_named(crafted):
    refused(crafted.zipped({"b": b""}), "has no member data")


@pytest.mark.parametrize("keep", [0, 10, -1, -30])
def test_truncated_archive_is_refused(crafted, keep):
    refused(crafted.zipped({"data": b"x" * 100})[:keep], "is damaged")


@pytest.mark.parametrize(
    "name", ["../data", "a/../../b", "/etc/passwd", "..\\b", "\\b", "C:\\b", "C:b"]
)
def test_paths_that_lead_outside_are_refused(crafted, name):
    refused(crafted.zipped({"data": b"", name: b""}), "leads outside")


def test_name_with_a_hidden_end_is_refused(crafted):
    content = crafted.zipped({"data": b"", "dataX..": b""}).replace(b"dataX..", b"data\x00..")
    refused(content, "leads outside|two members")


def test_declared_size_is_held_to(crafted):
    refused(crafted.zipped({"data": b"x" * 1_001}), "more than 1,000 bytes")


def test_decompression_bomb_costs_nothing(crafted):
    bomb = crafted.zipped({"data": bytes(100_000_000)}, zipfile.ZIP_DEFLATED)
    assert len(bomb) < 200_000
    with crafted.bounded(5_000_000):
        refused(bomb, "more than 1,000 bytes")


def test_bomb_that_lies_about_its_size_is_refused(crafted):
    bomb = crafted.zipped({"data": bytes(100_000_000)}, zipfile.ZIP_DEFLATED)
    lying = bomb.replace(struct.pack("<I", 100_000_000), struct.pack("<I", 900))
    with crafted.bounded(5_000_000):
        refused(lying, "damaged member data")


def test_changed_byte_is_found(crafted):
    refused(crafted.zipped({"data": b"AAAA"}).replace(b"AAAA", b"AAAB"), "damaged member data")


def test_too_many_members_are_refused(crafted):
    refused(crafted.zipped({str(n): b"" for n in range(MOST_MEMBERS + 1)}), "members")


def test_absurd_number_of_members_costs_nothing(crafted):
    entry = b"PK\x01\x02" + bytes(42)
    count = 200_000
    end = b"PK\x05\x06" + struct.pack(
        "<4H2IH", 0, 0, count % 65_536, count % 65_536, count * len(entry), 0, 0
    )
    content = entry * count + end
    with crafted.bounded(5_000_000):
        refused(content, "members")


def test_two_members_of_one_name_are_refused():
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        archive.writestr("data", b"1")
        archive.writestr("data", b"2")
    refused(buffer.getvalue(), "two members of one name")


def test_rare_compression_is_refused(crafted):
    refused(crafted.zipped({"data": b"x"}, zipfile.ZIP_LZMA), "rare compression")


def test_encrypted_member_is_refused(crafted):
    content = bytearray(crafted.zipped({"data": b"x"}))
    content[content.index(b"PK\x01\x02") + 8] |= 1
    refused(bytes(content), "encrypted")
