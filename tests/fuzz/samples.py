"""A small valid file of every kind that the program reads, and places that hold no file."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import io
import json
import os
import shutil
import socket
from pathlib import Path

import jax
import numpy as np
from benchmarks.recordings import write_csv
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)

from socialiq.cli.main import main
from socialiq.learners import fit
from socialiq.learners.state import History, Runs, TrainState
from socialiq.nn.dial_network import DialNetwork
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.q_network import QNetwork
from socialiq.nn.q_policy import QPolicy
from socialiq.social.angle_rule import load_rule
from socialiq.storage import packaged_results
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq.worlds.situation import ContextPolicy
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy
from socialiq_recordings import files as recording_files
from socialiq_recordings.export import write_commonroad
from socialiq_recordings.recording import Recording
from socialiq_recordings.road.network import Colour, Cycle, RoadNetwork, Sign

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
WORLD = "crossing5"
RULE = """
format = 1
world = "crossing5"
default = {by = "cells_to_conflict", at = [0, 2], degrees = [10.5, 80]}

[[when]]
angle = 60
approaching = {at_least = 1}
"""

ROUND_1000 = (
    "b44679b9a59af2ec876b1a6b1ad52ea9b1615fc3982b19576350f93447cb1125"
    "e342b73a8dd2bacbe47e4b6b63ed5e39"
)
"""Signature of round 1000 of drand's quicknet."""

SWEEP = """data = "steps.safetensors"
seeds = [0, 1]
[static]
updates = [2, 4]
hidden = [4]
value_term = "value_expert"
[hyperparameters]
angle = [0, 45.5]
"""

PARQUET = importlib.util.find_spec("pyarrow") is not None
"""Whether the extra is installed, as it is in the gate."""

MINARI = importlib.util.find_spec("h5py") is not None
"""Whether the extra is installed, as it is in the gate."""

FINGERPRINT = "a" * 64
"""Of the run of `untrained_runs`."""

COLUMNS = """format = "mine"
[time]
rate = 10.0
[columns]
id = "who"
frame = "frame"
x = "x"
y = "y"
heading = "heading"
vx = "vx"
vy = "vy"
length = "length"
width = "width"
class = "class"
[classes]
Car = "car"
"""


def call(*words: object) -> int:
    """Run a command in this process, without its output."""
    quiet = io.StringIO()
    with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
        status = main([str(word) for word in words])
    if status not in (0, 1, 3):
        raise RuntimeError(f"{words}: {quiet.getvalue()}")
    return status


def make_samples(folder: Path) -> None:
    """Fill a folder with a small valid file of every kind, by names that `calls` uses."""
    grid = make_grid(WORLD)
    table = tabulate(grid)
    data = folder / "steps.safetensors"
    call("collect", WORLD, "--episodes", "2", "--out", data)
    endings = ("npz", "csv", "parquet") if PARQUET else ("npz", "csv")
    for ending in endings:
        call("data", "to-arrays", data, "--out", folder / f"steps.{ending}")
    make_policies(folder, grid.n_features, grid.n_actions)
    TabularPolicy(grid, expert_policy(table, 0.0)).save(folder / "table.safetensors")
    new = ["profile", "new", "--world", WORLD, "--angle", "0", "--owner", "x"]
    call(*new, "--out", folder / "profile.toml")
    policy, profile = folder / "policy.safetensors", folder / "profile.toml"
    audit = ["audit", policy, "--profile", profile, "--out", folder / "report"]
    call(*audit, "--episodes", "20", "--log", folder / "log")
    _of_the_auditor(folder)
    _of_a_run(folder)
    if MINARI:
        call("data", "to-minari", data, "--out", folder / "minari")
        call("data", "to-arrays", data, "--out", folder / "steps.hdf5")
    _recordings(folder)
    _trajectories(folder / "rollouts.npz")
    (folder / "sweep.toml").write_text(SWEEP)
    make_stakeholders(folder)
    (folder / "columns.toml").write_text(COLUMNS)
    greeting = {"protocol": "socialiq-policy", "version": 1, "name": "x"}
    greeting |= {"features": grid.n_features, "actions": grid.n_actions}
    lines = [json.dumps(greeting), json.dumps({"id": 1, "actions": [0, 1]})]
    (folder / "answers.jsonl").write_text("\n".join(lines) + "\n")
    (folder / "evaluation.json").write_text('{"r_env": 1.0, "r_social": 0.5, "angle": 20.0}\n')
    shutil.copytree(packaged_results() / "poc", folder / "results")


def make_stakeholders(folder: Path) -> None:
    """Write two settings of two episodes, and two stakeholders."""
    rows = ["policy,angle,seed,r_env,delay", "go,,0,1.0,2.0", "go,,1,2.0,2.0"]
    rows += ["wait,,0,-1.0,9.0", "wait,,1,-1.0,8.0"]
    (folder / "episodes.csv").write_text("\n".join(rows) + "\n")
    passenger = "[passenger]\nweight = 1.0\nr_env = 1.0\n"
    (folder / "people.toml").write_text(f"{passenger}[drivers]\nweight = 1.0\ndelay = -0.1\n")


def _of_the_auditor(folder: Path) -> None:
    """The audit's log, a nonce, a beacon's round, a key, and the signed report."""
    (log,) = (folder / "log").glob("*.jsonl")
    shutil.copy(log, folder / "log.jsonl")
    call("audit", "nonce", "--out", folder / "nonce.json")
    (folder / "round.json").write_text(json.dumps({"round": 1000, "signature": ROUND_1000}) + "\n")
    key = Ed25519PrivateKey.from_private_bytes(bytes(32))
    words = Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()
    (folder / "private.pem").write_bytes(key.private_bytes(*words))
    public = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    (folder / "public.pem").write_bytes(public)
    shutil.copytree(folder / "report", folder / "signed")
    call("audit", "sign", folder / "signed", "--key", folder / "private.pem", "--believe")


def _of_a_run(folder: Path) -> None:
    """A checkpoint, and the file by which a cluster's scheduler is found."""
    history = History([1], {"loss": [np.zeros(2, np.float32)]})
    fit.save_checkpoint(folder / "checkpoint.safetensors", FINGERPRINT, untrained_runs(), history)
    scheduler = {"type": "Scheduler", "id": "Scheduler-1", "address": "tcp://127.0.0.1:8786"}
    (folder / "scheduler.json").write_text(json.dumps(scheduler | {"workers": {}}))


def untrained_runs() -> Runs:
    """Two runs of behaviour cloning before their first update."""

    def one(key: jax.Array) -> Runs:
        zero = jax.numpy.zeros((), jax.numpy.int32)
        state = TrainState.of(QNetwork.initialise(key, 2, (4,), 2))
        return Runs(state, key, zero, zero - 1, zero - 1)

    return jax.vmap(one)(jax.random.split(jax.random.key(0), 2))


def make_policies(folder: Path, features: int, actions: int) -> None:
    random = np.random.default_rng(0)
    shapes = [(4, features), (actions, 4)]
    weights = tuple(random.normal(size=shape).astype(np.float32) for shape in shapes)
    biases = tuple(np.zeros(shape[0], np.float32) for shape in shapes)
    QPolicy(weights, biases, "relu", 1.0).save(folder / "policy.safetensors")
    both = EnsemblePolicy.of([QPolicy(weights, biases, "relu", 1.0)] * 2)
    both.save(folder / "ensemble.safetensors")
    network = DialNetwork.initialise(jax.random.key(0), features, (4,), actions)
    dial = DialPolicy.of(network, 1.0, 0.0, 90.0, {})
    dial.save(folder / "dial.safetensors")
    (folder / "rule.toml").write_text(RULE)
    rule = load_rule(folder / "rule.toml")
    ContextPolicy.of(dial, rule).save(folder / "context.safetensors")
    for name in ("dqn_intersection.zip", "dqn_intersection.onnx"):
        shutil.copy(EXAMPLES / "policies" / name, folder / name)


def _recordings(folder: Path) -> None:
    xml = EXAMPLES / "recordings" / "ZAM_Crossing-1_1_T-1.xml"
    shutil.copy(xml, folder / "recording.xml")
    call("data", "import", "commonroad", xml, "--out", folder / "imported")
    (imported,) = (folder / "imported").glob("*.safetensors")
    shutil.copy(imported, folder / "recording.safetensors")
    call("data", "world", imported, "--out", folder / "world.safetensors")
    found = recording_files.load(imported)
    tracks = found.tracks
    lanelets = dict(found.road.lanelets)
    first = min(lanelets)
    cycle = Cycle(((Colour.RED, 30), (Colour.GREEN, 20)), offset=-4)
    lanelets[first] = dataclasses.replace(lanelets[first], sign=Sign.LIGHT, cycle=cycle)
    lit = Recording(tracks, RoadNetwork(lanelets))
    recording_files.save(folder / "lit.safetensors", lit)
    write_commonroad(lit, folder / "lit.xml")
    (folder / "ind").mkdir()
    write_csv(dataclasses.replace(tracks, recording="0"), "ind", folder / "ind")
    make_sind(folder / "sind")
    rows = [
        f"{who},{f},{f / 2},{4 * who},0.0,5.0,0.0,4.5,1.8,Car" for who in (1, 2) for f in range(9)
    ]
    head = "who,frame,x,y,heading,vx,vy,length,width,class"
    (folder / "mine.csv").write_text("\n".join([head, *rows]) + "\n")


def make_sind(folder: Path) -> None:
    """Two files of tracks and one of lights in SinD's layout, of 12 frames."""
    folder.mkdir()
    head = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy"
    times = [(f, 100.1001 * f, 0.1 * f) for f in range(12)]
    walking = [
        f"P{n},{f},{ms},pedestrian,{n},{1.5 * t},0,1.5" for n in (1, 2) for f, ms, t in times
    ]
    driving = [f"1,{f},{ms},car,{8 * t - 9},3,8,0,0,4.5,1.8" for f, ms, t in times]
    driving += [f"2,{f},{ms},tricycle,{20 - 4 * t},9,-4,0,3.1416,2.4,1.1" for f, ms, t in times]
    lights = ["30,,0,1", "42,400.4,0,3", "48,600.6,1,3", "60,1001.001,1,0"]
    tables = {"Ped_smoothed_tracks": [f"{head},ax,ay", *(f"{row},0,0" for row in walking)]}
    tables["Veh_smoothed_tracks"] = [f"{head},yaw_rad,length,width", *driving]
    tables["Traffic_Lights"] = ["RawFrameID,timestamp(ms),Traffic light 1,Traffic light 2", *lights]
    for name, rows in tables.items():
        (folder / f"made_{name}.csv").write_text("\n".join(rows) + "\n")


def _trajectories(path: Path) -> None:
    """The arrays of the imitation library: two episodes of two steps and one."""
    np.savez(
        path,
        allow_pickle=False,
        obs=np.arange(10, dtype=np.float32).reshape(5, 2),
        acts=np.array([0, 1, 1]),
        rews=np.array([1.0, 0.0, 2.0]),
        terminal=np.array([True, False]),
        indices=np.array([2]),
    )
    rows = ["obs_0,obs_1,acts,next_obs_0,next_obs_1,rews,terminal,trajectory"]
    rows += ["0,1,0,2,3,1.0,false,0", "2,3,1,4,5,0.0,true,0", "6,7,1,8,9,2.0,false,1"]
    path.with_suffix(".csv").write_text("\n".join(rows) + "\n")


def make_bad_places(folder: Path) -> None:
    """Fill a folder with things that no reader can read."""
    (folder / "empty").write_bytes(b"")
    (folder / "bytes").write_bytes(np.random.default_rng(0).bytes(4096))
    (folder / "zeros").write_bytes(bytes(4096))
    (folder / "text").write_text("not what you expect\n")
    (folder / "object.json").write_text("{}\n")
    (folder / "deep.json").write_text("[" * 100_000)
    (folder / "folder").mkdir()
    (folder / "full").mkdir()
    (folder / "full" / "mine.txt").write_text("keep me\n")
    (folder / "loop").symlink_to(folder / "loop")
    (folder / "dangling").symlink_to(folder / "nowhere")
    (folder / "zero").symlink_to("/dev/zero")
    os.mkfifo(folder / "fifo")
    with socket.socket(socket.AF_UNIX) as one:
        here = Path.cwd()
        os.chdir(folder)  # a socket's path has at most 107 characters
        try:
            one.bind("socket")
        finally:
            os.chdir(here)
