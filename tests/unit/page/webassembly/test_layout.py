"""The layout that the page reads is that of the arrays in Python."""

import base64
import json

import numpy as np

from socialiq.page.webassembly.layout import layout
from socialiq.worlds.highway.options import SETTINGS, SIGNALS, VEHICLE, Buffers
from socialiq.worlds.intersection.options import Options, buffers_of


def test_it_is_json_and_names_every_buffer_first():
    found = json.loads(json.dumps(layout(Options())))
    names = [one["name"] for one in found["arrays"]]
    assert tuple(names[: len(Buffers._fields)]) == Buffers._fields
    assert names[len(Buffers._fields) :] == ["commands", "entropy", "seeded", "actions", "settings"]


def test_rows_have_the_bytes_of_numpys_arrays():
    buffers = buffers_of(Options(), 3, traced=True)
    for one in layout(Options())["arrays"][: len(Buffers._fields)]:
        array = getattr(buffers, one["name"])
        assert one["bytes"] * int(np.prod(one["shape"])) * 3 == array.nbytes, one["name"]


def test_fields_of_a_vehicle_lie_where_numpy_has_them():
    record = layout(Options())["records"]["vehicle"]
    assert record["size"] == VEHICLE.itemsize
    assert record["fields"]["heading"] == ("float64", VEHICLE.fields["heading"][1])
    assert record["fields"]["yielding"] == ("bool", VEHICLE.fields["yielding"][1])


def test_settings_and_weights_are_those_of_the_options():
    options = Options(collision_weight=-7.0)
    found = layout(options)
    record = np.frombuffer(base64.b64decode(found["settings"]), SETTINGS)
    assert record["weights"][0, SIGNALS.index("collision")] == -7.0
    assert found["weights"][SIGNALS.index("collision")] == -7.0
