"""Minari reads what is written, it comes back to the bit; data of others are read or refused."""

import json
import subprocess
import sys
from typing import Any

import gymnasium
import numpy as np
import pytest

pytest.importorskip("minari", reason="extra `minari` is not installed")
pytest.importorskip("h5py", reason="extra `minari` is not installed")

import h5py
import minari
from minari.serialization import deserialize_space

from socialiq.cli.main import main
from socialiq.datasets import hdf5
from socialiq.datasets.minari import read_minari, write_minari
from socialiq.demonstrations import files
from socialiq.demonstrations.mixture import equal_trajectories
from socialiq.errors import UserError
from socialiq.evaluation.rollout import MODES, demonstrations_by_mode
from socialiq.worlds import wrapper

# Minari's own: authors that are not named, a temporary folder that it forgets.
OF_MINARI = pytest.mark.filterwarnings("ignore::UserWarning", "ignore::ResourceWarning")


@pytest.fixture(scope="module")
def table(table7):
    return equal_trajectories(demonstrations_by_mode(table7, dict.fromkeys(MODES, 4), 0), 4, 0)


@pytest.fixture
def written(table, tmp_path):
    write_minari(table, tmp_path / "mixed")
    return tmp_path / "mixed"


def changed(folder, change):
    """Change the HDF5 file of a data set."""
    with h5py.File(folder / "data" / "main_data.hdf5", "a") as file:
        change(file)


def told(folder, **changes):
    """Change the metadata of a data set; None leaves an entry out."""
    path = folder / "data" / "metadata.json"
    metadata = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({k: v for k, v in metadata.items() if v is not None}))


def replace(file, name, data):
    del file[name]
    file[name] = data


def same(a, b):
    pairs = zip(a.arrays().items(), b.arrays().items(), strict=True)
    assert (a.mode_names, a.n_actions, a.source) == (b.mode_names, b.n_actions, b.source)
    for (name, x), (other, y) in pairs:
        assert name == other and x.dtype == y.dtype and x.tobytes() == y.tobytes(), name


def test_every_column_comes_back_to_the_bit(table, written):
    same(read_minari(written), table)
    same(read_minari(written / "data"), table)
    assert len(np.unique(table.ending)) >= 3 and table.rewards.social.any()


def test_unfinished_episodes_and_other_numbers_come_back(table, tmp_path):
    arrays = {name: column[:7].copy() for name, column in table.arrays().items()}
    arrays["observation"][0] = -0.0
    arrays["r_env"][:3] = (1 / 3, 1e300, -0.0)
    arrays["ending"][:] = arrays["terminated"][:] = arrays["truncated"][:] = 0
    arrays["episode"][:], arrays["step"][:] = 0, np.arange(7)
    arrays["next_observation"][:6] = arrays["observation"][1:]
    part = type(table).of_arrays(arrays, table.mode_names, table.n_actions, table.source)
    write_minari(part, tmp_path / "part")
    same(read_minari(tmp_path / "part"), part)


def test_minari_itself_reads_it(table, written):
    dataset = minari.MinariDataset(str(written / "data"))
    assert dataset.total_episodes == table.n_episodes
    assert dataset.total_steps == table.n_transitions
    assert dataset.action_space == gymnasium.spaces.Discrete(table.n_actions)
    assert dataset.spec.dataset_id == "mixed-v0"
    first = dataset[0]
    steps = table.episode_lengths[0]
    assert first.observations.shape == (steps + 1, table.n_features)
    pair = first.infos["reward_vector"]
    assert pair.shape == (steps + 1, 2) and not pair[0].any()
    assert np.array_equal(pair[1:, 1], table.rewards.social[:steps])
    assert np.array_equal(first.rewards, table.rewards.env[:steps])  # angle 0
    ends = np.concatenate([episode.terminations for episode in dataset])
    assert np.array_equal(ends, table.terminated)


def test_the_one_reward_is_the_score_of_the_angle(table, tmp_path):
    write_minari(table, tmp_path / "social", angle=90.0)
    dataset = minari.MinariDataset(str(tmp_path / "social" / "data"))
    rewards = np.concatenate([episode.rewards for episode in dataset])
    assert np.array_equal(rewards, table.rewards.social)
    metadata = json.loads((tmp_path / "social" / "data" / "metadata.json").read_text())
    assert metadata["socialiq"]["reward_angle"] == 90.0
    same(read_minari(tmp_path / "social"), table)


def test_minaris_own_root_is_used_only_where_it_is_named(table, tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "root"))
    write_minari(table, tmp_path / "elsewhere")
    assert not (tmp_path / "root").exists()
    (tmp_path / "root" / "socialiq").mkdir(parents=True)
    name = "socialiq/mixed-v1"
    write_minari(table, tmp_path / "root" / name, dataset_id=name)
    assert minari.load_dataset(name).total_steps == table.n_transitions


@OF_MINARI
def test_a_part_that_minari_split_off_is_read(table, written, tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "root"))
    dataset = minari.MinariDataset(str(written / "data"))
    part = dataset.filter_episodes(lambda episode: episode.id < 4)
    make_buffer: Any = minari.data_collector.EpisodeBuffer  # pyright: ignore
    buffers = [
        make_buffer(
            observations=one.observations,
            actions=one.actions,
            rewards=one.rewards,
            terminations=one.terminations,
            truncations=one.truncations,
            infos=one.infos,
        )
        for one in part
    ]
    minari.create_dataset_from_buffers(
        "part-v0",
        buffers,
        observation_space=dataset.observation_space,
        action_space=dataset.action_space,
    )
    back = read_minari(tmp_path / "root" / "part-v0")
    assert back.n_episodes == 4 and back.source == {"made_by": "minari", "of": "part-v0"}
    rows = back.n_transitions
    for name in ("observation", "action", "r_env", "r_social", "ending", "mode"):
        assert np.array_equal(back.arrays()[name], table.arrays()[name][:rows])


def collected(env, folder, episodes=2, **options):
    """Data set that Minari's own collector records, by its first action."""
    name = f"{folder.name}-v0"
    collector = minari.DataCollector(env, record_infos=False, **options)
    for seed in range(episodes):
        collector.reset(seed=seed)
        while True:
            _, _, terminated, truncated, _ = collector.step(env.action_space.sample())
            if terminated or truncated:
                break
    dataset = collector.create_dataset(name)
    collector.close()
    return dataset, folder.parent / name


@pytest.fixture
def cartpole(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = gymnasium.make("CartPole-v1")
    env.action_space.seed(0)
    return collected(env, tmp_path / "cartpole")


@OF_MINARI
def test_foreign_data_are_read_without_an_environment(cartpole, monkeypatch):
    dataset, folder = cartpole
    with pytest.raises(UserError, match="r_social is not known"):
        read_minari(folder)
    monkeypatch.setattr(gymnasium, "make", None)
    table = read_minari(folder, social="none", mode="random")
    assert table.n_episodes == 2 and table.n_transitions == dataset.total_steps
    assert table.mode_names == ("random",) and table.n_actions == 2
    assert table.ending[table.episode_starts[1] - 1] == 4 and not table.rewards.social.any()
    seen = dataset[0].observations.astype(np.float32)
    steps = table.episode_lengths[0]
    assert np.array_equal(table.observation[:steps], seen[:-1])
    assert np.array_equal(table.next_observation[:steps], seen[1:])
    from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
    from socialiq.learners.iq_learn.train import train

    static = IQLearnConfig(
        online=False, value_term="value_expert", updates=5, hidden=(4,), batch_size=4
    )
    assert train(static, [IQLearnHyperparameters(angle=0.0)], [table]).failures == ()


@OF_MINARI
def test_an_environment_that_metadata_name_is_never_made(cartpole, tmp_path):
    """Without spaces Minari would import and call what the metadata name."""
    _, folder = cartpole
    trap = tmp_path / "touched"
    spec = json.loads(json.loads((folder / "data" / "metadata.json").read_text())["env_spec"])
    spec |= {"entry_point": "os:mkdir", "kwargs": {"path": str(trap)}}
    told(folder, env_spec=json.dumps(spec), observation_space=None)
    with pytest.raises(UserError, match="have no observation_space"):
        read_minari(folder, social="none")
    assert not trap.exists()
    with pytest.raises(Exception):  # noqa: B017  Gymnasium's
        minari.MinariDataset(str(folder / "data"))
    assert trap.exists()  # the trap is one


@pytest.mark.parametrize(
    ("space", "match"),
    [
        (
            {"type": "Box", "dtype": "float32", "shape": [2, 2]},
            "actions of a Box space of shape .2, 2.: only discrete",
        ),
        ({"type": "MultiDiscrete", "nvec": [2, 2], "start": [0, 0]}, "of a MultiDiscrete space"),
        ({"type": "Dict", "subspaces": {}}, "of a Dict space"),
        ({"type": "Discrete", "n": 2**40, "start": 0}, "only discrete"),
        ({"type": "Discrete", "n": "3"}, "only discrete"),
        ({"type": "<script>\u202e\n", "n": 3}, "of a <script> space"),
        ({}, "have no action_space"),
    ],
)
def test_other_actions_are_refused(written, space, match):
    told(written, action_space=json.dumps(space))
    refused(written, match)


@pytest.mark.parametrize(
    ("space", "match"),
    [
        ({"type": "Dict", "subspaces": {}}, "observations of a Dict space"),
        ({"type": "Tuple", "subspaces": []}, "observations of a Tuple space"),
        ({"type": "Text"}, "observations of a Text space"),
        ({"type": "Box", "dtype": "float32", "shape": [5, 1]}, "flatten them"),
        ({"type": "Box", "dtype": "uint8", "shape": [64, 64, 3]}, "keeps images as JPEG"),
        ({"type": "Box", "dtype": "float32", "shape": [60]}, "where .*60.* is due"),
        ({"type": "Box", "shape": "ab"}, "have no observation_space"),
        ([], "have no observation_space"),
    ],
)
def test_other_observations_are_refused(written, space, match):
    told(written, observation_space=json.dumps(space))
    refused(written, match)


def refused(folder, match, **options):
    with pytest.raises(UserError, match=match) as caught:
        read_minari(folder, **options)
    text = str(caught.value)
    assert "\n" not in text and text.isprintable() and len(text) < 500


def test_rewards_of_two_numbers_a_step_are_the_pair(written, table):
    told(written, socialiq=None)

    def paired(file):
        for group in file.values():
            pair = group["infos/reward_vector"][1:]
            del group["infos"]
            replace(group, "rewards", pair)

    changed(written, paired)
    back = read_minari(written)
    assert np.array_equal(back.rewards.env, table.rewards.env)
    assert np.array_equal(back.rewards.social, table.rewards.social) and back.rewards.social.any()
    name = "episode_0/rewards"
    changed(written, lambda file: replace(file, name, file[name][:, 0]))
    refused(written, "in some episodes only")
    changed(written, lambda file: replace(file, name, np.zeros((len(file[name]), 3))))
    refused(written, r"where \((\d+),\) or \(\1, 2\) is due")


WHOLE = {
    "Discrete": ({"start": 2, "n": 5}, lambda steps: steps % 5 + 2),
    "MultiBinary": ({"n": [2, 3]}, lambda steps: steps[:, None] // 2 ** np.arange(6) % 2),
    "MultiDiscrete": (
        {"dtype": "int64", "nvec": [3, 2], "start": [0, 1]},
        lambda steps: np.stack([steps % 3, steps % 2 + 1], axis=1),
    ),
}


@pytest.mark.parametrize("kind", WHOLE)
def test_whole_numbers_are_the_features_of_an_environment_of_their_space(written, kind):
    words, values = WHOLE[kind]
    described = {"type": kind, **words}
    told(written, socialiq=None, observation_space=json.dumps(described))
    space = deserialize_space(json.dumps(described))

    def whole(file):
        for group in file.values():
            seen = values(np.arange(len(group["actions"]) + 1))
            replace(group, "observations", seen.reshape(-1, *space.shape))

    changed(written, whole)
    table = read_minari(written)
    seen = values(np.arange(table.episode_lengths[0])).reshape(-1, *space.shape)
    expected = [gymnasium.spaces.flatten(space, row) for row in seen]
    np.testing.assert_array_equal(table.observation[: len(seen)], expected)
    assert table.n_features == wrapper.flat_space(space).shape[0]


@pytest.mark.parametrize(
    ("space", "match"),
    [
        ({"type": "Discrete", "n": 2}, "observes a whole number that the space does not have"),
        ({"type": "Discrete", "n": 10**9}, "1,000,000,000 numbers as one-hot vectors"),
        ({"type": "Discrete", "n": 10**30}, "have no Discrete observation_space"),
        ({"type": "Discrete", "n": 0}, "have no Discrete observation_space"),
        ({"type": "MultiBinary", "n": "many"}, "have no MultiBinary observation_space"),
        ({"type": "MultiDiscrete", "nvec": [2, -1]}, "have no MultiDiscrete observation_space"),
    ],
)
def test_whole_numbers_of_another_space_are_refused(written, space, match):
    told(written, socialiq=None, observation_space=json.dumps(space))

    def whole(file):
        for group in file.values():
            replace(group, "observations", np.arange(len(group["actions"]) + 1))

    changed(written, whole)
    refused(written, match)


def test_images_are_flattened_where_that_is_said(written, table):
    def four(file):
        for group in file.values():
            seen = group["observations"][()]
            replace(group, "observations", np.stack([seen, seen], axis=1))

    changed(written, four)
    shape = [2, table.n_features]
    space = json.dumps({"type": "Box", "dtype": "float32", "shape": shape})
    told(written, observation_space=space, socialiq=None)
    refused(written, "flatten them")
    back = read_minari(written, flatten=True)
    assert np.array_equal(back.observation, np.hstack([table.observation] * 2))


def test_actions_that_begin_elsewhere_are_numbered_from_0(written, table):
    def up(file):
        for group in file.values():
            replace(group, "actions", group["actions"][()] + 5)

    changed(written, up)
    told(written, action_space=json.dumps({"type": "Discrete", "n": table.n_actions, "start": 5}))
    same(read_minari(written), table)


def test_another_content_is_not_what_was_written(written):
    changed(
        written,
        lambda file: file["episode_0/infos/reward_vector"].write_direct(
            np.ones(file["episode_0/infos/reward_vector"].shape)
        ),
    )
    refused(written, "SHA-256 differs")
    told(written, socialiq=None)
    assert read_minari(written).rewards.env[0] == 1.0


FIRST = "episode_0/"


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda f: f.pop(FIRST + "rewards"), "lacks episode_0/rewards"),
        (lambda f: f.pop(FIRST + "observations"), "lacks episode_0/observations"),
        (lambda f: f.pop("episode_1"), "holds 11 episodes, but its metadata say 12"),
        (lambda f: f.move("episode_1", "episode_x"), "lacks episode_1/actions"),
        (lambda f: replace(f, FIRST + "actions", np.zeros(50, int)), "of episode_0 has shape"),
        (lambda f: replace(f, FIRST + "truncations", np.full(9, 7)), "of episode_0|boolean"),
        (lambda f: replace(f, FIRST + "rewards", np.array(1.0)), "not an array of numbers"),
        (lambda f: replace(f, FIRST + "rewards", ["a", "b"]), "object, not an array of numbers"),
        (lambda f: replace(f, FIRST + "rewards", h5py.Empty("f8")), "not an array of numbers"),
        (
            lambda f: replace(f, FIRST + "rewards", np.zeros(2, [("a", "f8")])),
            "not an array of numb",
        ),
        (lambda f: (f.pop(FIRST + "rewards"), f.create_group(FIRST + "rewards")), "is nested"),
        (lambda f: (f.pop("episode_0"), f.create_dataset("episode_0", data=1)), "lacks episode_0"),
        (lambda f: f.pop(FIRST + "infos/reward_vector"), "in some episodes only"),
        (
            lambda f: replace(f, FIRST + "infos/reward_vector", np.zeros((2, 3))),
            "pair of episode_0 has shape",
        ),
    ],
)
def test_changed_files_are_refused(written, change, match):
    changed(written, change)
    refused(written, match)


def test_links_and_external_numbers_are_never_followed(written, tmp_path):
    (tmp_path / "secret").write_bytes(b"\1" * 8_000)
    with h5py.File(tmp_path / "other.hdf5", "w") as other:
        other["rewards"] = np.zeros(9)

    def external(file):
        del file["episode_0/rewards"]
        places = [(str(tmp_path / "secret"), 0, h5py.h5f.UNLIMITED)]
        file.create_dataset("episode_0/rewards", (9,), "f8", external=places)

    def elsewhere(file):
        del file["episode_0/rewards"]
        file["episode_0/rewards"] = h5py.ExternalLink(str(tmp_path / "other.hdf5"), "rewards")

    def virtual(file):
        del file["episode_0/rewards"]
        layout = h5py.VirtualLayout((9,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.hdf5"), "rewards", (9,))
        file.create_virtual_dataset("episode_0/rewards", layout)

    def soft(file):
        del file["episode_0/rewards"]
        file["episode_0/rewards"] = h5py.SoftLink("/episode_1/rewards")

    for change, match in (
        (external, "is stored in another file"),
        (elsewhere, "a link to another place"),
        (virtual, "is stored in another file"),
        (soft, "a link to another place"),
    ):
        changed(written, change)
        refused(written, match)


def test_huge_counts_cost_nothing(written):
    told(written, total_episodes=10**15)
    refused(written, "metadata say 1000000000000000")
    told(written, total_episodes=12)

    def huge(file):
        del file["episode_3/rewards"]
        file.create_dataset("episode_3/rewards", (2**50,), "f8", chunks=(1024,))

    changed(written, huge)
    assert (written / "data" / "main_data.hdf5").stat().st_size < 1_000_000
    refused(written, "claims more than")


def test_limits_are_of_all_arrays_together(written, monkeypatch):
    monkeypatch.setattr(hdf5, "MOST_NUMBERS", 500)
    refused(written, "claims more than")


def test_truncated_and_foreign_files_are_refused(written):
    path = written / "data" / "main_data.hdf5"
    whole = path.read_bytes()
    for content in (b"", whole[:100], whole[: len(whole) // 2], b"\0" * 4096, b"CDF\x01" * 99):
        path.write_bytes(content)
        refused(written, "damaged or no HDF5 file")
    path.unlink()
    refused(written, "no such file")


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ("", "cannot read"),
        ("[" * 100_000, "cannot read"),
        ("[]", "has no total_episodes"),
        ('{"total_episodes": "12"}', "has no total_episodes"),
        ('{"total_episodes": 12, "data_format": "arrow"}', "data_format is arrow"),
    ],
)
def test_other_metadata_are_refused(written, content, match):
    (written / "data" / "metadata.json").write_text(content)
    refused(written, match)


def test_tables_that_skip_steps_cannot_be_said(table, tmp_path):
    with pytest.raises(UserError, match=r"row \d+ does not follow the row before it"):
        write_minari(table.subsample(3), tmp_path / "x")
    with pytest.raises(UserError, match="row 0 does not follow"):
        write_minari(table.subsample(1, 1), tmp_path / "x")
    assert list(tmp_path.iterdir()) == []


def test_names_and_folders_that_cannot_be(table, tmp_path, written):
    with pytest.raises(UserError, match="exists already"):
        write_minari(table, written)
    for name in ("a b-v0", "../x-v0", "x", "-v0"):
        with pytest.raises(UserError, match="is not a Minari name"):
            write_minari(table, tmp_path / "new", dataset_id=name)
    with pytest.raises(UserError, match="cannot make"):
        write_minari(table, tmp_path / "missing" / "new")
    assert [path.name for path in tmp_path.iterdir()] == ["mixed"]


def test_without_room_nothing_is_written(table, tmp_path):
    """HDF5 ended the process by a signal where a write failed, and half a file stayed."""
    files.save(tmp_path / "table.safetensors", table)
    limited = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)); "
    start = "from socialiq.cli.main import main; raise SystemExit(main())"
    words = ["data", "to-minari", str(tmp_path / "table.safetensors"), "--out"]
    ended = subprocess.run(
        [sys.executable, "-c", limited + start, *words, str(tmp_path / "room-v0")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert "make room, or choose another place" in line
    assert [path.name for path in tmp_path.iterdir()] == ["table.safetensors"]


def test_commands_write_and_read(table, tmp_path, capsys):
    source, back = tmp_path / "mixed.safetensors", tmp_path / "back.safetensors"
    sha256 = files.save(source, table)
    folder = tmp_path / "set-v3"
    assert main(["data", "to-minari", str(source), "--out", str(folder), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["id"], found["sha256"]) == ("set-v3", sha256)
    assert main(["data", "from-minari", str(folder), "--out", str(back), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["sha256"] == sha256
    same(files.load(back), table)
    assert main(["data", "from-minari", str(folder), "--out", str(back)]) == 2
    assert "exists already" in capsys.readouterr().err
