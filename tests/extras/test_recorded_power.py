"""`data power` through the command line, on hand-made crossings."""

import dataclasses
import json

import pytest

pytest.importorskip("shapely", reason="extra `maps` is not installed")
pytest.importorskip("sklearn", reason="extra `prediction` is not installed")

from tests.extras.test_recorded_conflicts import east, north, recording, steady

from socialiq.cli.main import main
from socialiq.results_folder import load
from socialiq_recordings import files
from socialiq_recordings.recording import Recording

QUICK = ["--spreads", "0", "35", "--sizes", "1", "2", "--repeats", "1", "--resamples", "100"]


@pytest.fixture(scope="module")
def crossings(tmp_path_factory):
    """Four recordings, in each two vehicles that are in a conflict for five seconds."""
    folder = tmp_path_factory.mktemp("crossings")
    paths = []
    for number in range(4):
        speed = 9.0 + 0.4 * number
        made = recording(
            east(-42 - number, steady(speed, 60)), north(-45 + number, steady(10.5, 60))
        )
        tracks = dataclasses.replace(made.tracks, recording=f"crossing {number}")
        paths.append(str(folder / f"{number}.safetensors"))
        files.save(folder / f"{number}.safetensors", Recording(tracks, made.road))
    return paths


def test_the_command_says_what_four_chains_could_show(crossings, tmp_path, capsys):
    out = tmp_path / "power"
    assert main(["data", "power", *crossings, *QUICK, "--out", str(out), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["drivers"], printed["chains"]) == (8, 4)
    assert printed["chains_needed"] == 8
    rows = {(row["population"], row["size"]): row for row in printed["power"]}
    assert ("spread 0", 2) in rows and ("spread 35", 1) in rows
    assert rows["spread 0", 1]["detected"] == 0.0  # four chains find nothing
    assert rows["spread 35", 2]["drivers"] == 16
    assert (out / "power.png").is_file()
    assert load(out).config["simulation"]["sizes"] == [1, 2]
    few = ["--spreads", "0", "--sizes", "1", "--repeats", "1"]
    assert main(["data", "power", *crossings, *few]) == 0
    said = capsys.readouterr()
    assert "Simulated drivers at" in said.out
    assert "not enough data: with 4 independent chains" in said.out + said.err


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--sizes", "0"], "sizes must be whole numbers from 1 to 1000"),
        (["--spreads", "200"], "spreads must be from 0 to 90 degrees"),
        (["--strength", "nan"], "strength must be above 0"),
        (["--repeats", "0"], "repeats must be from 1 to 10000"),
        (["--gain", "1"], "gain must be a share between 0 and 1"),
    ],
)
def test_options_out_of_range_end_in_one_line(crossings, more, says, capsys):
    assert main(["data", "power", *crossings, *more]) == 2
    said = capsys.readouterr().err
    assert says in said and "Traceback" not in said


def test_recordings_without_a_conflict_end_in_one_line(tmp_path, capsys):
    paths = []
    for number in range(3):
        made = recording(east(-70, steady(8 + number, 60)), north(40, steady(9, 60)))
        tracks = dataclasses.replace(made.tracks, recording=f"free {number}")
        paths.append(str(tmp_path / f"{number}.safetensors"))
        files.save(tmp_path / f"{number}.safetensors", Recording(tracks, made.road))
    assert main(["data", "power", *paths]) == 2
    assert "no driver has decisions in conflict in both halves" in capsys.readouterr().err
    assert main(["data", "power", paths[0], str(tmp_path / "none.safetensors")]) == 2
    assert "none.safetensors" in capsys.readouterr().err
