"""Makes the files and the answers of this folder; run at version 0.3.0, whose code it needs.

`python -m tests.old_files.make FOLDER`
"""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import sys
import tempfile
from pathlib import Path

import jax
import numpy as np
from tests.fuzz.samples import make_samples

from socialiq.cli.main import main
from socialiq.nn.actor_policy import ActorDial, ActorPolicy
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.worlds.registry import make

SAMPLES = (
    "steps.safetensors", "policy.safetensors", "ensemble.safetensors", "dial.safetensors",
    "context.safetensors", "table.safetensors", "profile.toml", "rule.toml", "sweep.toml",
    "columns.toml", "people.toml", "checkpoint.safetensors", "evaluation.json", "log.jsonl",
    "public.pem", "world.safetensors", "recording.safetensors",
)  # fmt: skip
"""Samples of the fuzzer that are kept."""

DECLARED = (
    "crosswalk7", "intersection", "intersection-crosswalk", "intersection-caused",
    "intersection-crosswalk-60", "intersection-crosswalk-bicycles", "intersection-continuous",
    "intersection-continuous-steering-offroad", "merge", "roundabout",
)  # fmt: skip
"""Worlds of declarations, by the names of 0.3.0."""

COMMANDS = (
    "solve crossing5 --angle 45",
    "front crossing5",
    "evaluate policy.safetensors --world crossing5 --angle 45 --episodes 20",
    "evaluate ensemble.safetensors --world crossing5 --episodes 20",
    "evaluate dial.safetensors --world crossing5 --angle 30 --episodes 20",
    "evaluate context.safetensors --world crossing5 --episodes 20",
    "dial crossing5 --policy dial.safetensors --every 30",
    "evaluate gap_3s --world intersection --episodes 4",
    "evaluate gap_3s --world intersection-crosswalk --episodes 4",
    "evaluate gap_3s --world intersection-crosswalk-60 --episodes 4",
    "evaluate road_class_dial.safetensors --world intersection-crosswalk --angle 30 --episodes 4",
    "evaluate road_actor.safetensors --world intersection-continuous --episodes 4",
    "evaluate road_actor_dial.safetensors --world intersection-continuous --angle 30 --episodes 4",
    "evaluate road_steering.safetensors --world intersection-continuous-steering --episodes 4",
    "evaluate road_steering.safetensors --world intersection-continuous-steering-offroad "
    "--episodes 4",
    "evaluate scene_policy.safetensors --world merge --episodes 4",
    "evaluate scene_policy.safetensors --world roundabout --episodes 4",
    "effects intersection --policy gap_3s --episodes 4",
    "effects intersection-crosswalk --policy gap_3s --episodes 4",
    "effects intersection-crosswalk-bicycles --policy gap_3s --episodes 4",
    "effects merge --policy scene_policy.safetensors --episodes 4",
    "effects crosswalk7 --policy crosswalk_policy.safetensors",
    "evaluate crosswalk_policy.safetensors --world crosswalk7-60 --angle 45 --episodes 20",
    "evaluate road_policy.safetensors --world intersection --shift late --episodes 4",
    "evaluate road_policy.safetensors --world intersection --front-end latency=1,track=3 "
    "--episodes 4",
    "population --policy road_dial.safetensors --angle 0 90 --agents 2 --episodes 2",
    *(f"profile check {world}.toml" for world in DECLARED),
    "audit verify report",
    "audit policy.safetensors --profile profile.toml --episodes 40 --seed 5 --out OUT/audit",
    "collect crossing5 --episodes 2 --out OUT/collected.safetensors",
    "export policy.safetensors --format card --out OUT/card.md",
    "turn dial.safetensors --angle 45 --out OUT/turned.safetensors",
    "stakeholders episodes.csv --utilities people.toml --resamples 20",
    "train behaviour-cloning steps.safetensors --out OUT/cloned --set updates=2 hidden=4",
    "data to-arrays steps.safetensors --out OUT/steps.csv",
)
"""Commands of 0.3.0; OUT is an empty folder."""


def answered(command: str, folder: Path) -> dict[str, object]:
    """Run a command in a folder of the files; return its exit status and what `--json` prints."""
    out = io.StringIO()
    with tempfile.TemporaryDirectory() as empty, contextlib.chdir(folder):
        words = [word.replace("OUT", empty) for word in command.split()]
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
            status = main([*words, "--json"])
        text = out.getvalue().replace(empty, "OUT")
    try:
        answer = json.loads(text)
    except ValueError:
        answer = None
    return {"status": status, "answer": answer}


def random_policy(path: Path, inputs: int, outputs: int) -> QPolicy:
    """Save a policy with random weights and return it."""
    random = np.random.default_rng(inputs + 100 * outputs)
    shapes = [(4, inputs), (outputs, 4)]
    weights = tuple(random.normal(size=shape).astype(np.float32) for shape in shapes)
    policy = QPolicy(weights, tuple(np.zeros(n, np.float32) for n, _ in shapes), "relu", 1.0)
    policy.save(path)
    return policy


def layers(inputs: int, outputs: int) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return random weights and no biases."""
    random = np.random.default_rng(inputs + 100 * outputs)
    shapes = [(4, inputs), (outputs, 4)]
    weights = tuple(random.normal(size=shape).astype(np.float32) for shape in shapes)
    return weights, tuple(np.zeros(n, np.float32) for n, _ in shapes)


def make_files(folder: Path) -> None:
    """Fill an empty folder."""
    with tempfile.TemporaryDirectory() as place:
        samples = Path(place)
        make_samples(samples)
        for name in SAMPLES:
            if (samples / name).exists():
                shutil.copy(samples / name, folder / name)
        for name in ("report", "episodes.csv"):
            source = samples / name
            (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / name)
    crosswalk = make("crosswalk7")
    random_policy(folder / "crosswalk_policy.safetensors", crosswalk.n_features, 3)
    random_policy(folder / "road_policy.safetensors", 70, 3)
    random_policy(folder / "scene_policy.safetensors", 35, 5)
    walked = make("intersection-crosswalk").n_features
    ClassDial(random_policy(folder / "road_class.safetensors", walked + 3, 3), 0.0, 90.0).save(
        folder / "road_class_dial.safetensors"
    )
    ActorPolicy(*layers(70, 2), "elu", 1).save(folder / "road_actor.safetensors")
    ActorPolicy(*layers(70, 4), "elu", 2).save(folder / "road_steering.safetensors")
    ActorDial(ActorPolicy(*layers(72, 2), "relu", 1), 0.0, 90.0).save(
        folder / "road_actor_dial.safetensors"
    )
    network = DialNetwork.initialise(jax.random.key(1), 70, (4,), 3)
    DialPolicy.of(network, 1.0, 0.0, 90.0, {}).save(folder / "road_dial.safetensors")
    for world in DECLARED:
        words = ["profile", "new", "--world", world, "--angle", "45", "--owner", "x"]
        main([*words, "--out", str(folder / f"{world}.toml")])


if __name__ == "__main__":
    target = Path(sys.argv[1])
    make_files(target)
    answers = {command: answered(command, target) for command in COMMANDS}
    (target / "answers.json").write_text(json.dumps(answers, indent=1, sort_keys=True) + "\n")
    for command, answer in answers.items():
        print(answer["status"], command)
