"""Files of plain arrays: what is written comes back to the bit, and what is wrong is one line."""

import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays as some_arrays

from socialiq.datasets.step_files import read_steps, write_steps
from socialiq.datasets.step_tables import columns_of, csv_of, read_csv
from socialiq.demonstrations import files
from socialiq.demonstrations.dataset import Demonstrations
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair

HEADER = (
    "observation_0,observation_1,action,next_observation_0,next_observation_1,"
    "terminated,r_env,r_social"
)
ROWS = ("0,1,1,1,1,false,-1,0.5", "1,1,0,2,1,true,5,0", "7.5,1,1,8,1,true,1e-3,-0.0")


@pytest.fixture
def table():
    """Two drivers, a mode without episodes, and an end that is terminal and truncated at once."""
    rng, rows = np.random.default_rng(4), 9
    made = Demonstrations.of(
        observation=rng.standard_normal((rows, 3)) / 3,
        action=rng.integers(0, 3, rows),
        next_observation=-rng.standard_normal((rows, 3)) * 1e-30,
        ending=[0, 0, Ending.ARRIVAL, 0, Ending.TIMEOUT, 0, 0, 0, Ending.COLLISION],
        rewards=RewardPair(rng.standard_normal(rows) / 7, [-0.0, 1e300, 5e-324, *range(6)]),
        episode=[0, 0, 0, 1, 1, 2, 2, 2, 2],
        mode=[0, 0, 0, 2, 2, 0, 0, 0, 0],
        mode_names=("bold", "absent", "patient"),
        n_actions=4,
        source={"made_by": "a test", "seed": 4},
    )
    both = {**made.arrays(), "truncated": made.truncated | (np.arange(rows) == 2)}
    return Demonstrations.of_arrays(both, made.mode_names, made.n_actions, made.source)


def written(path, lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def assert_same_columns(one, other):
    for name, column in one.arrays().items():
        again = other.arrays()[name]
        assert again.dtype == column.dtype and again.tobytes() == column.tobytes(), name


def test_an_archive_comes_back_to_the_hash(table, tmp_path):
    write_steps(tmp_path / "x.npz", table)
    back = read_steps(tmp_path / "x.npz")
    assert files.sha256_of(back) == files.sha256_of(table)


def test_csv_comes_back_to_the_bit(table, tmp_path):
    write_steps(tmp_path / "x.csv", table)
    back = read_steps(tmp_path / "x.csv", n_actions=4, mode_names=table.mode_names)
    assert_same_columns(table, back)
    assert (back.n_actions, back.mode_names) == (4, ("bold", "absent", "patient"))
    assert back.source["file"] == "x.csv" and len(back.source["sha256"]) == 64


@pytest.mark.parametrize("ending", [".npz", ".csv"])
def test_a_subsampled_table_comes_back_too(table, tmp_path, ending):
    thin, path = table.subsample(2), tmp_path / f"x{ending}"
    write_steps(path, thin)
    given = {"n_actions": 4, "mode_names": table.mode_names} if ending == ".csv" else {}
    assert_same_columns(thin, read_steps(path, **given))
    assert thin.step.tolist() != list(range(len(thin.step)))


finite32 = st.floats(width=32, allow_nan=False, allow_infinity=False)
finite64 = st.floats(allow_nan=False, allow_infinity=False)


@given(some_arrays(np.float32, 5, elements=finite32), some_arrays(np.float64, 5, elements=finite64))
def test_every_number_survives_csv(tmp_path_factory, narrow, wide):
    columns = {
        "observation_0": narrow,
        "action": np.arange(5, dtype=np.int32),
        "reward": wide,
        "terminated": np.arange(5) > 3,
    }
    path = tmp_path_factory.mktemp("csv") / "x.csv"
    path.write_bytes(csv_of(columns))
    found = read_csv(path)
    assert found["observation_0"].astype(np.float32).tobytes() == narrow.tobytes()
    assert found["reward"].tobytes() == wide.tobytes()
    assert found["terminated"].tolist() == [False] * 4 + [True]


def test_the_text_is_plain_csv(table, tmp_path):
    write_steps(tmp_path / "x.csv", table)
    with (tmp_path / "x.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(columns_of(table))
    assert list(rows[0])[:4] == ["observation_0", "observation_1", "observation_2", "action"]
    assert [row["terminated"] for row in rows[:3]] == ["false", "false", "true"]
    assert [float(row["r_social"]) for row in rows[:3]] == [-0.0, 1e300, 5e-324]


def test_a_csv_of_another_program(tmp_path):
    """A byte order mark, spaces, an empty line, columns in any order."""
    lines = ["\ufeff" + HEADER.replace(",", " , "), ROWS[0], "", *ROWS[1:]]
    table = read_steps(written(tmp_path / "x.csv", lines), n_actions=2)
    assert table.observation.tolist() == [[0, 1], [1, 1], [7.5, 1]]
    assert table.next_observation[:, 0].tolist() == [1, 2, 8]
    assert table.ending.tolist() == [0, 4, 4] and table.episode.tolist() == [0, 0, 1]
    assert table.rewards.env.tolist() == [-1, 5, 1e-3] and table.mode_names == ("demonstrator",)


def test_one_reward_a_step_needs_a_word(tmp_path):
    header = HEADER.replace(",r_env,r_social", ",reward")
    rows = (row.rpartition(",")[0] for row in ROWS)
    path = written(tmp_path / "x.csv", [header, *rows])
    assert not read_steps(path, n_actions=2, social="none").rewards.social.any()
    with pytest.raises(UserError, match="r_social is not known"):
        read_steps(path, n_actions=2)


@pytest.mark.parametrize(
    ("header", "match"),
    [
        ("observation_0,action", "no column r_env, r_social"),
        ("observation_0,action,r_env", "no column r_social"),
        ("observation_0,r_env,r_social", "no column action"),
        ("action,r_env,r_social", "no column observation_0"),
        ("observation_0,observation_2,action,reward", "observation_2 but no column observation_1"),
        ("observation_1,action,reward", "observation_1 but no column observation_0"),
        ("observation_00,action,reward", "unknown column 'observation_00'"),
        ("observation_0,action,reward,speed", "unknown column 'speed'.*known are observation_0, "),
        ("observation_0,action,action,reward", "two columns action"),
        ("observation_0,action,reward,r_env", "reward beside r_env"),
        (
            "observation_0,observation_1,next_observation_0,action,reward",
            "2 columns observation_0, ... and 1 columns next_observation_0",
        ),
        ("observation_0,action,reward", "nothing says where an episode ends"),
        ("", "is empty"),
    ],
)
def test_a_wrong_header_is_named(tmp_path, header, match):
    row = ",".join("1" for _ in header.split(","))
    path = written(tmp_path / "x.csv", [header, row] if header else [])
    path.write_text(path.read_text() if header else "")
    with pytest.raises(UserError, match=match) as caught:
        read_steps(path, n_actions=2, social="none")
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("row", "match"),
    [
        ("0,1,x,1,1,false,1,1", "line 3: column action is 'x', not an integer"),
        ("0,1,1.0,1,1,false,1,1", "line 3: column action is '1.0', not an integer"),
        ("0,1,99999999999999999999,1,1,false,1,1", "column action is '9{20}', not an integer"),
        ("0,1,1,1,1,false,,1", "line 3: column r_env is '', not a number"),
        ("0,1_0,1,1,1,false,1,1", "column observation_1 is '1_0', not a number"),
        ("0,1,1,1,1,maybe,1,1", "line 3: column terminated is 'maybe', not true or false"),
        ("0,1,1,1,1,false,nan,1", "column r_env, row 1: not finite"),
        ("0,inf,1,1,1,false,1,1", "column observation_1, row 1: not finite"),
        ("0,1e300,1,1,1,false,1,1", "column observation, row 1: not finite"),
        ("0,1,1,1,1,false,1", "line 3: 7 cells for 8 columns"),
        ("0,1,1,1,1,false,1,1,1", "line 3: 9 cells for 8 columns"),
        ("0,1,5,1,1,false,1,1", "column action, row 1: outside"),
        ('0,1,1,1,1,false,1,"1', "line"),
    ],
)
def test_a_wrong_row_is_named(tmp_path, row, match):
    path = written(tmp_path / "x.csv", [HEADER, ROWS[0], row, ROWS[1]])
    with pytest.raises(UserError, match=match) as caught:
        read_steps(path, n_actions=2)
    assert "\n" not in str(caught.value) and str(path) in str(caught.value)


def test_files_that_cannot_be_read(tmp_path, table):
    with pytest.raises(UserError, match=r"unknown format '.txt': choose one"):
        read_steps(tmp_path / "x.txt", n_actions=2)
    with pytest.raises(UserError, match="unknown format"):
        write_steps(tmp_path / "x.xlsx", table)
    with pytest.raises(UserError, match="no such file"):
        read_steps(tmp_path / "x.csv", n_actions=2)
    with pytest.raises(UserError, match="pass --n-actions"):
        read_steps(written(tmp_path / "x.csv", [HEADER, *ROWS]))
    with pytest.raises(UserError, match="no row but its header"):
        read_steps(written(tmp_path / "x.csv", [HEADER]), n_actions=2)
    (tmp_path / "x.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UserError, match="not UTF-8"):
        read_steps(tmp_path / "x.csv", n_actions=2)


def test_what_the_file_tells_is_not_overruled(table, tmp_path):
    path = tmp_path / "x.npz"
    write_steps(path, table)
    with pytest.raises(UserError, match="has the number of actions: 4, not 3"):
        read_steps(path, n_actions=3)
    with pytest.raises(UserError, match="has the modes"):
        read_steps(path, mode_names=("demonstrator",))
    with np.load(path) as archive:
        arrays = dict(archive)
    np.savez(path, **{**arrays, "action": arrays["action"][::-1]})
    with pytest.raises(UserError, match="not what was written"):
        read_steps(path)
    np.savez(path, **{**arrays, "socialiq": np.frombuffer(b'{"n_actions": "4"}', np.uint8)})
    with pytest.raises(UserError, match="socialiq entry that cannot be read"):
        read_steps(path)


LOGGED = """run,who,charge,level,power,profit,cost,done,notes
b,greedy,0.5,1,fast,1.5,2,False,x
b,greedy,0.7,0,off,1,0,True,
a,polite,0.5,2,slow,2,1,False,
a,polite,0.6,1,slow,2,1,False,
a,polite,0.9,0,off,2,0,False,
"""
MAP = """
[columns]
observation = ["charge", "level"]
action = "power"
r_env = "profit"
r_social = "cost"
mode = "who"
episode = "run"
done = "done"
[scales]
cost = -0.5
[words]
power = ["off", "slow", "fast"]
level = 3
"""


def logged(folder, log=LOGGED, columns=MAP):
    (folder / "log.csv").write_text(log)
    (folder / "map.toml").write_text(columns)
    return read_steps(folder / "log.csv", n_actions=3, columns=folder / "map.toml")


def test_a_csv_as_people_log_it(tmp_path):
    """The last step of `a` is left out: no terminal state follows, and no observation."""
    data = logged(tmp_path)
    assert data.counts() == {"greedy": (1, 2), "polite": (1, 2)}
    assert data.observation[0].tolist() == [0.5, 0, 1, 0]
    assert data.next_observation[:, 0].astype("f8").round(3).tolist() == [0.7, 0.7, 0.6, 0.9]
    assert data.action.tolist() == [2, 0, 1, 1]
    assert data.rewards.social.tolist() == [-1, 0, -0.5, -0.5]
    assert data.ending.tolist() == [0, Ending.OTHER, 0, Ending.TIMEOUT]


@pytest.mark.parametrize(
    ("changed", "line"),
    [
        ({"log": LOGGED.replace("charge", "a").replace("cost", "b")}, "no column charge, cost: "),
        (
            {"log": LOGGED.replace("b,greedy,0.5", "b,greedy,x").replace("off", "of")},
            "line 2: column observation_0 is 'x', not a number; .*line 3: column action is 'of', ",
        ),
        (
            {"log": LOGGED.replace("0.5,2", "0.5,3")},
            "line 4: column observation_1 is .3., not one of its words",
        ),
        ({"log": LOGGED + "c,polite,1,1,off,1,1,False,\n"}, "episode 2 has one step, and what"),
        ({"columns": MAP.replace("done =", "over =")}, "columns. over: known are observation, "),
        ({"columns": MAP.replace("[scales]", "[scale]")}, "scale is unknown: known are columns"),
        ({"columns": MAP.replace("cost = -0.5", "costs = -1")}, "costs is unknown: known are"),
        ({"columns": MAP.replace("-0.5", "'a'")}, "must have tables: columns of names, scales of"),
        ({"columns": "words = 3"}, "must have tables"),
    ],
)
def test_faults_of_a_map_or_its_file_are_named(changed, line, tmp_path):
    with pytest.raises(UserError, match=line) as caught:
        logged(tmp_path, **changed)
    assert "\n" not in str(caught.value)
