"""Parquet in and out through pyarrow: to the bit, plain numbers only, and nothing unpickled."""

import json
import sys

import numpy as np
import pytest

pytest.importorskip("pyarrow", reason="extra `parquet` is not installed")

import pyarrow
from pyarrow import ipc, parquet

from socialiq.cli.main import main
from socialiq.datasets.step_files import read_steps, write_steps
from socialiq.datasets.trajectories import read_trajectories
from socialiq.demonstrations import files
from socialiq.demonstrations.mixture import equal_trajectories
from socialiq.errors import UserError
from socialiq.evaluation.rollout import MODES, demonstrations_by_mode
from socialiq.types import Ending


@pytest.fixture(scope="module")
def table(table7):
    return equal_trajectories(demonstrations_by_mode(table7, dict.fromkeys(MODES, 4), 0), 4, 0)


GOOD = {
    "observation_0": pyarrow.array([0.0, 1.0, 5.0]),
    "action": pyarrow.array([0, 1, 0], pyarrow.int8()),
    "r_env": pyarrow.array([1, 2, 3]),
    "r_social": pyarrow.array([0.5, 0.0, 0.0], pyarrow.float32()),
    "next_observation_0": pyarrow.array([1.0, 2.0, 6.0]),
    "truncated": pyarrow.array([False, True, True]),
}


def written(path, **changed):
    columns = {name: column for name, column in (GOOD | changed).items() if column is not None}
    parquet.write_table(pyarrow.table(columns), path)
    return path


def test_it_comes_back_to_the_hash(table, tmp_path):
    for one in (table, table.subsample(3)):
        write_steps(tmp_path / "x.parquet", one)
        assert files.sha256_of(read_steps(tmp_path / "x.parquet")) == files.sha256_of(one)


def test_other_programs_read_it(table, tmp_path):
    write_steps(tmp_path / "x.parquet", table)
    found = parquet.read_table(tmp_path / "x.parquet")
    assert found.num_rows == table.n_transitions
    assert found.column("observation_5").to_numpy().tobytes() == table.observation[:, 5].tobytes()
    assert found.schema.field("action").type == pyarrow.int32()
    assert json.loads(found.schema.metadata[b"socialiq"])["mode_names"] == list(MODES)


def test_trajectories_are_read_as_from_csv(tmp_path):
    columns = {
        "obs_0": [0.0, 1.0, 5.0],
        "acts": [1, 0, 1],
        "r_env": [1.0, 2.0, 3.0],
        "r_social": [0.5, 0.0, 0.0],
        "next_obs_0": [1.0, 2.0, 6.0],
        "terminal": [False, True, False],
        "trajectory": [3, 3, 5],
    }
    parquet.write_table(pyarrow.table(columns), tmp_path / "x.parquet")
    table = read_trajectories(tmp_path / "x.parquet", n_actions=2)
    assert table.observation[:, 0].tolist() == [0, 1, 5] and table.ending.tolist() == [0, 4, 0]
    assert table.episode.tolist() == [0, 0, 1] and table.rewards.social.tolist() == [0.5, 0, 0]


def test_the_commands_go_both_ways(table, tmp_path, capsys):
    files.save(tmp_path / "in.safetensors", table)
    middle, back = str(tmp_path / "x.parquet"), str(tmp_path / "out.safetensors")
    assert main(["data", "to-arrays", str(tmp_path / "in.safetensors"), "--out", middle]) == 0
    assert main(["data", "from-arrays", middle, "--out", back, "--json"]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found["sha256"] == files.sha256_of(table)


def test_a_file_of_another_program(tmp_path):
    table = read_steps(written(tmp_path / "x.parquet"), n_actions=2, mode_names=("human",))
    assert table.observation.ravel().tolist() == [0, 1, 5]
    assert table.ending.tolist() == [0, 3, 3] and table.episode.tolist() == [0, 0, 1]
    assert table.rewards.env.tolist() == [1, 2, 3] and table.source["file"] == "x.parquet"


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"action": None}, "no column action"),
        ({"speed": GOOD["r_env"]}, "unknown column 'speed'"),
        ({"action": pyarrow.array([0.0, 1.0, 0.0])}, "column action is double: write it as int"),
        ({"action": pyarrow.array(["a", "b", "c"])}, "column action is string"),
        ({"action": pyarrow.array([b"a", b"b", b"c"])}, "column action is binary"),
        ({"action": pyarrow.array([[0], [1], [0]])}, "column action is list"),
        ({"action": pyarrow.array([0, None, 1])}, "column action, row 1 is empty"),
        ({"observation_0": pyarrow.array([0.0, None, 1.0])}, "observation_0, row 1 is empty"),
        ({"observation_0": pyarrow.array([0.0, 1.0, np.nan])}, "observation_0, row 2: not finite"),
        ({"r_env": pyarrow.array(["1", "2", "3"])}, "column r_env is string: write it as numbers"),
        ({"truncated": pyarrow.array([0, 1, 1])}, "column truncated is int64: write it as bool"),
        ({"r_env": pyarrow.array([0, 1, 2], pyarrow.timestamp("s"))}, "column r_env is timestamp"),
        ({"r_env": pyarrow.array(["a", "b", "a"]).dictionary_encode()}, "r_env is dictionary"),
        ({"r_env": pyarrow.nulls(3)}, "column r_env is null"),
    ],
)
def test_a_wrong_column_is_named(tmp_path, changed, match):
    with pytest.raises(UserError, match=match) as caught:
        read_steps(written(tmp_path / "x.parquet", **changed), n_actions=2)
    assert "\n" not in str(caught.value) and "x.parquet" in str(caught.value)


class Foreign(pyarrow.ExtensionType):
    """A type of another program, whose making would be seen."""

    made = 0

    def __init__(self):
        super().__init__(pyarrow.int64(), "another.library")

    def __arrow_ext_serialize__(self):
        return b""

    @classmethod
    def __arrow_ext_deserialize__(cls, storage_type, serialized):
        cls.made += 1
        return cls()


def test_extension_types_are_refused(tmp_path):
    pyarrow.register_extension_type(Foreign())
    try:
        column = pyarrow.ExtensionArray.from_storage(Foreign(), pyarrow.array([0, 1, 0]))
        path = written(tmp_path / "x.parquet", action=column)
        with pytest.raises(UserError, match="column action is extension"):
            read_steps(path, n_actions=2)
    finally:
        pyarrow.unregister_extension_type("another.library")


def test_damage_and_bombs(table, tmp_path, monkeypatch):
    from socialiq.datasets import step_tables

    path = tmp_path / "x.parquet"
    write_steps(path, table)
    whole = path.read_bytes()
    for content in (b"", whole[:-1], whole[: len(whole) // 2], b"PAR1" + bytes(64) + b"PAR1"):
        path.write_bytes(content)
        with pytest.raises(UserError, match="damaged or no Parquet file"):
            read_steps(path)
    many = pyarrow.table({name: pyarrow.repeat(column[0], 10**5) for name, column in GOOD.items()})
    parquet.write_table(many, path)
    assert path.stat().st_size < 20_000
    monkeypatch.setattr(step_tables, "MOST_NUMBERS", 10**5)
    with pytest.raises(UserError, match="claims more than 100,000 numbers"):
        read_steps(path, n_actions=2)


def test_without_pyarrow_it_says_what_to_install(table, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.delitem(sys.modules, "pyarrow.parquet", raising=False)
    (tmp_path / "x.parquet").write_bytes(b"PAR1")
    for act in (
        lambda: read_steps(tmp_path / "x.parquet", n_actions=2),
        lambda: write_steps(tmp_path / "y.parquet", table),
    ):
        with pytest.raises(UserError, match=r"pip install 'socialiq\[parquet\]'"):
            act()


SEEN = [[[0.0, 1.0], [1.0, 2.0], [2.0, 3.0]], [[5.0, 1.0], [6.0, 1.0]]]
SAVED = {
    "obs": SEEN,
    "acts": [[0, 1], [1]],
    "rews": [[1.0, 2.0], [3.0]],
    "terminal": [True, False],
    "infos": [["{}", '{"TimeLimit.truncated": true, "other": {"py/object": "os.system"}}'], ["{}"]],
}


def saved(folder, parts=1, **columns):
    """A folder as `datasets` saves one, of columns that take the place of some."""
    folder.mkdir(exist_ok=True)
    table = pyarrow.table(SAVED | columns)
    for part in range(parts):
        path = folder / f"data-{part:05}-of-{parts:05}.arrow"
        with ipc.new_stream(str(path), table.schema) as stream:
            stream.write_table(table)
    return folder


def test_folder_of_imitation_is_read(tmp_path):
    table = read_trajectories(saved(tmp_path / "a", parts=2), n_actions=2, social="none")
    assert table.counts() == {"demonstrator": (4, 6)}
    assert table.observation[:3].tolist() == [[0.0, 1.0], [1.0, 2.0], [5.0, 1.0]]
    assert table.next_observation[:3].tolist() == [[1.0, 2.0], [2.0, 3.0], [6.0, 1.0]]
    assert table.rewards.env.tolist() == [1.0, 2.0, 3.0] * 2
    assert table.ending[:2].tolist() == [0, Ending.TIMEOUT]
    pairs = [[[1.0, 2.0], [3.0, 4.0]], [[5.0, 6.0]]]
    table = read_trajectories(saved(tmp_path / "b", rews=pairs), n_actions=2)
    assert table.rewards.social.tolist() == [2.0, 4.0, 6.0]
    infos = [['{"reward_pair": [7, 8]}'] * 2, ['{"reward_pair": [9, 8.5]}']]
    table = read_trajectories(saved(tmp_path / "c", infos=infos), n_actions=2)
    assert table.rewards.env.tolist() == [7.0, 7.0, 9.0]
    assert table.rewards.social.tolist() == [8.0, 8.0, 8.5]


OBJECT = [['{"reward_pair": {"py/reduce": []}}', "{}"], ["{}"]]


@pytest.mark.parametrize(
    ("columns", "match"),
    [
        ({"obs": [[[0.0, 1.0], [1.0], [2.0, 3.0]], SEEN[1]]}, "obs has rows of several lengths"),
        ({"obs": [["a", "b", "c"], ["d", "e"]]}, "obs holds string or empty cells"),
        ({"obs": [[[0.0], [None], [1.0]], [[1.0], [2.0]]]}, "obs holds double or empty cells"),
        ({"obs": [[{"a": 1.0}] * 3, [{"a": 1.0}] * 2]}, "obs holds struct"),
        ({"obs": [1, 2]}, "obs is int64: save a list"),
        ({"acts": [[0], [1]]}, "trajectory 0: obs has 3 rows for 1 actions"),
        ({"rews": [None, None]}, "trajectory 0: no reward"),
        ({"infos": [["{", "{}"], ["{}"]]}, "infos holds a text that is no JSON"),
        ({"infos": OBJECT}, "reward_pair in infos is an object, which is not made"),
    ],
)
def test_folders_of_other_content_are_refused(tmp_path, columns, match):
    with pytest.raises(UserError, match=match) as caught:
        read_trajectories(saved(tmp_path / "a", **columns), n_actions=2, social="none")
    assert "\n" not in str(caught.value)


def test_damaged_folders_are_refused(tmp_path):
    folder = saved(tmp_path / "a")
    [part] = folder.iterdir()
    content = part.read_bytes()
    for damaged in (b"", content[:100], content[:-400], b"x" * 500):
        part.write_bytes(damaged)
        with pytest.raises(UserError, match=r"data-00000-of-00001\.arrow"):
            read_trajectories(folder, n_actions=2, social="none")
    part.unlink()
    with pytest.raises(UserError, match=r"a folder without data-\*\.arrow"):
        read_trajectories(folder, n_actions=2)
