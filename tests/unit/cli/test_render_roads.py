"""`render` on roads: pictures and films of policy files, and mistakes in one line."""

from pathlib import Path

import jax
import pytest
from PIL import Image

from socialiq.cli.main import main
from socialiq.nn.actor import Actor
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    network = QNetwork.initialise(jax.random.key(0), 35, (4,), 5)
    QPolicy.of(network, 1.0, {}).save(Path("q.safetensors"))
    QPolicy.of(QNetwork.initialise(jax.random.key(0), 36, (4,), 5), 1.0, {}).save(
        Path("timed.safetensors")
    )
    actor = Actor.initialise(jax.random.key(0), 71 + 2, (4,), 2)
    ActorDial(ActorPolicy.of(actor, {}), 0.0, 90.0).save(Path("dial.safetensors"))


@pytest.mark.parametrize(
    ("world", "words"),
    [
        ("merge", ["--driver", "q.safetensors"]),
        ("merge", ["--driver", "timed.safetensors"]),
        ("roundabout", ["--driver", "q.safetensors"]),
        ("roundabout", []),
        ("intersection-continuous-steering-offroad", ["--driver", "dial.safetensors"]),
        (
            "intersection-continuous-steering",
            ["--driver", "dial.safetensors", "--angle", "45"],
        ),
    ],
)
def test_pictures_are_drawn(files, world, words):
    assert main(["render", world, *words, "--seed", "3", "--out", "drawn.png"]) == 0
    with Image.open("drawn.png") as drawn:
        assert drawn.width >= 600


def test_a_film_has_a_frame_for_each_sub_step(files):
    words = ["--driver", "q.safetensors", "--seed", "3", "--out", "film.gif"]
    assert main(["render", "roundabout", *words]) == 0
    with Image.open("film.gif") as film:
        assert film.n_frames % 15 == 1 and film.n_frames > 15


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["merge", "--driver", "gone", "--out", "x.png"], "unknown driver 'gone'"),
        (["merge", "--out", "x.gif"], "a film needs an episode: add --driver"),
        (["merge", "--driver", "q.safetensors", "--angle", "9", "--out", "x.png"], "of a dial"),
        (["merge", "--angle", "9", "--out", "x.png"], "add --driver, a dial"),
        (["merge", "--driver", "dial.safetensors", "--out", "x.png"], "name the world it was made"),
        (["intersection", "--driver", "q.safetensors", "--out", "x.png"], "the world has 70 and 3"),
        (["intersection", "--driver", "go", "--angle", "9", "--out", "x.png"], "of a dial"),
        (["crossing7", "--driver", "go", "--out", "x.png"], "has no --driver: use --angle"),
        (["crossing7", "--out", "x.gif"], "choose one of .png"),
        (
            ["merg", "--out", "x.png"],
            "intersection, merge, roundabout, two_way",
        ),
    ],
)
def test_mistakes_are_one_line(files, words, says, capsys):
    assert main(["render", *words]) == 2
    line = capsys.readouterr().err
    assert says in line and line.count("\n") == 1
    assert not Path(words[-1]).exists()
