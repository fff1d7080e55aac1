"""The minute of fuzzing in the gate: damaged files, the same ones each time."""

import shutil

import pytest
from tests.fuzz.readers import READERS, place_of
from tests.fuzz.run_readers import Counts, property_of

EXAMPLES = 25


def named(reader):
    return reader.name


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("reader", READERS, ids=named)
def test_a_damaged_file_is_read_or_refused_in_one_line(runner, tmp_path, reader):
    counts = Counts()
    place = place_of(reader, runner.ok, tmp_path)
    shutil.copy(runner.ok / reader.sample, place)
    reader.read(place)  # the sample itself
    property_of(reader, runner.ok, tmp_path, EXAMPLES, None, counts)()
    assert counts.files >= EXAMPLES
