import pytest

from socialiq.errors import UserError
from socialiq.policies.onnx_load import MOST_FIELDS, check_fields


def varint(value):
    made = bytearray()
    while value > 127:
        made.append(value & 127 | 128)
        value >>= 7
    return bytes([*made, value])


def inside(number, content):
    """A field that holds bytes, text or a message."""
    return varint(number << 3 | 2) + varint(len(content)) + content


def whole(number, value):
    return varint(number << 3) + varint(value)


GRAPH = inside(1, inside(1, b"x") + inside(2, b"y") + inside(4, b"Relu")) + inside(2, b"name")
MODEL = whole(1, 8) + inside(2, b"producer") + inside(7, GRAPH) + inside(8, whole(2, 17))


def refused(content, match):
    with pytest.raises(UserError, match=match) as caught:
        check_fields(content, "some.onnx")
    assert "\n" not in str(caught.value)


def in_graph(field):
    return MODEL + inside(7, field)


def in_tensor(field):
    return in_graph(inside(5, whole(1, 3) + field))


def in_attribute(field):
    return in_graph(inside(1, inside(5, inside(1, b"value") + field)))


def test_plain_model_passes():
    tensor, attribute = inside(9, bytes(100)), inside(5, inside(9, bytes(8)))
    for model in (MODEL, in_tensor(tensor), in_attribute(attribute)):
        assert check_fields(model, "some.onnx") is None


def test_fields_of_external_data_are_counted_too():
    entry = inside(13, inside(1, b"location") + inside(2, b"weights"))
    for field in (entry, whole(14, 1)):
        for content in (in_tensor(field), in_attribute(inside(5, field))):
            assert check_fields(content, "some.onnx") is None
    refused(in_tensor(inside(13, inside(3, b""))), "field 3 of a type")
    refused(in_tensor(entry * MOST_FIELDS), "more than 20000 fields")


def test_ways_round_the_initialisers_are_refused():
    refused(in_graph(inside(15, b"")), "sparse initialisers")
    refused(in_attribute(inside(22, b"")), "sparse tensors")
    refused(in_attribute(inside(6, inside(15, b""))), "sparse initialisers")
    refused(in_attribute(inside(11, GRAPH)), "sub-graphs")
    refused(MODEL + inside(20, b""), "training steps")
    refused(MODEL + inside(25, b""), "functions")


def test_unknown_fields_are_refused():
    refused(MODEL + inside(99, b""), "field 99 of a model")
    refused(in_graph(whole(99, 1)), "field 99 of a graph")
    refused(in_graph(inside(1, inside(8, b"overload"))), "field 8 of a node")
    refused(in_graph(inside(11, inside(2, inside(4, b"")))), "field 4 of a type")


@pytest.mark.parametrize(
    "field", [inside(1, b""), inside(5, b""), inside(11, b""), inside(5, b"\x08\x01")]
)
def test_huge_counts_cost_nothing(crafted, as_a_user_runs_it, field):
    content = inside(7, field * 2_000_000)
    with crafted.bounded(20_000_000):
        refused(content, f"more than {MOST_FIELDS} fields")


@pytest.mark.parametrize(
    "content",
    [
        MODEL[:-1],
        MODEL[:5],
        b"\x08",
        b"\xff" * 20,
        inside(7, b"")[:-1] + b"\x05",
        varint(7 << 3 | 2) + varint(2**60) + b"x",
        varint(7 << 3 | 3),  # a group
        b"PK\x03\x04" + bytes(100),
        inside(7, inside(1, b"\x0a\x7fx")),  # reaches beyond its node
    ],
)
def test_damage_is_refused(content):
    refused(content, "is damaged or not an ONNX file|has field")
