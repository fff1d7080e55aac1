"""Every reader of a file: what it reads, a valid example, and a use of what it returns."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from tests.fuzz.samples import COLUMNS, FINGERPRINT, MINARI, PARQUET, WORLD, untrained_runs

from socialiq import results_folder
from socialiq.audit import log
from socialiq.audit.profile import reader as profiles
from socialiq.audit.report.signature import (
    faults_of_signature,
    read_private_key,
    read_public_key,
)
from socialiq.audit.report.verify import faults, read_report
from socialiq.audit.seeds import read_nonce, read_round
from socialiq.datasets.minari import read_minari
from socialiq.datasets.step_files import read_steps
from socialiq.datasets.trajectories import read_trajectories
from socialiq.demonstrations import files as demonstration_files
from socialiq.errors import UserError
from socialiq.learners import fit
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.policies import process
from socialiq.policies.interface import Interface
from socialiq.policies.load import load_policy
from socialiq.social.angle_rule import AngleRule, load_rule
from socialiq.storage import load_arrays, read_json
from socialiq.worlds.registry import make_grid
from socialiq.worlds.situation import check_rule
from socialiq_lab import claims
from socialiq_lab.cluster import scheduler_address
from socialiq_lab.sweep.plan import read_plan
from socialiq_recordings import files as recording_files
from socialiq_recordings.readers import import_file
from socialiq_recordings.readers.column_map import read_map
from socialiq_recordings.readers.commonroad_road import road_of
from socialiq_recordings.world.recorded_world import RecordedWorld

GRID = make_grid(WORLD)


class Reader(NamedTuple):
    """A reader of one kind of file.

    Attributes:
        name: Its name.
        sample: The valid file, below the samples.
        read: Reads a path and uses what it found.
        beside: Folder of the sample that is copied too, because other files belong to it.
        resealed: Whether the file carries a hash of its content, so that damage to the content
            is only seen by the reader if the hash is made again.
    """

    name: str
    sample: str
    read: Callable[[Path], Any]
    beside: bool = False
    resealed: bool = False


def _act(policy: Any, features: int) -> None:
    """Let a policy decide twice, from a start of the world if it is of the world."""
    start = np.array(GRID.start[0][0], np.float32)
    fits = features == GRID.n_features
    observations = np.stack([start, start]) if fits else np.zeros((2, features), np.float32)
    for deterministic in (True, False):
        actions, _ = policy.predict(observations, deterministic=deterministic)
        if np.shape(actions) != (2,):
            raise AssertionError(f"actions of shape {np.shape(actions)}")


def _policy(path: Path) -> None:
    with load_policy(str(path), GRID.n_features, GRID.n_actions, angle=30.0) as loaded:
        _act(loaded.policy, GRID.n_features)
        json.dumps(loaded.record.as_json(), allow_nan=False)


def _foreign(path: Path) -> None:
    with load_policy(str(path), 70, 3) as loaded:
        _act(loaded.policy, 70)
        json.dumps(loaded.record.as_json(), allow_nan=False)


def _own_policy(path: Path) -> None:
    policy = QPolicy.load(path)
    _act(policy, policy.n_features)


def _own_dial(path: Path) -> None:
    dial = DialPolicy.load(path)
    policy = dial.at((dial.low + dial.high) / 2)
    _act(policy, policy.n_features)


def _rule(path: Path) -> None:
    rule = load_rule(path)
    assert AngleRule.of(rule.as_json()) == rule
    check_rule(rule)


def _steps(path: Path) -> None:
    modes = ("egoistic", "prosocial", "altruistic") if path.suffix == ".csv" else ()
    _whole(read_steps(path, n_actions=GRID.n_actions, mode_names=modes))


def _rollouts(path: Path) -> None:
    _whole(read_trajectories(path, n_actions=2, social="none"))


def _whole(table: Any) -> None:
    if table.n_transitions < 1 or not np.isfinite(table.observation).all():
        raise AssertionError("no transition, or one that is not finite")
    demonstration_files.sha256_of(table)


def _demonstrations(path: Path) -> None:
    _whole(demonstration_files.load(path))


def _recording(path: Path) -> None:
    found = recording_files.load(path)
    if not np.isfinite(found.tracks.x).all():
        raise AssertionError("a position that is not finite")


def _recorded_world(path: Path) -> None:
    world = RecordedWorld.load(path)
    if not np.isfinite(world.road.line).all() or world.n_actions < 2:
        raise AssertionError("a line that is not finite, or no actions")


def _commonroad(path: Path) -> None:
    _saved(import_file(path, "commonroad"), path)


def _saved(imported: list[Any], path: Path) -> None:
    """Save what was imported, and read it back."""
    for one in imported:
        if not np.isfinite(one.recording.tracks.x).all():
            raise AssertionError("a position that is not finite")
        made = path.with_suffix(".imported")
        recording_files.save(made, one.recording)
        recording_files.load(made)


def _ind(path: Path) -> None:
    _saved(import_file(path.with_name("0_tracks.csv"), "csv", read_map("ind")), path)


def _sind(path: Path) -> None:
    _saved(import_file(path.with_name("made_Ped_smoothed_tracks.csv"), "sind"), path)


def _mine(path: Path) -> None:
    columns = path.with_name("columns.toml")
    if not columns.exists():
        columns.write_text(COLUMNS)
    _saved(import_file(path, "csv", read_map(str(columns))), path)


def _columns(path: Path) -> None:
    read_map(str(path))


def _report(path: Path) -> None:
    read_report(path)


_WHOLE: dict[Path, bytes] = {}
"""Content of the sample that a damaged file was made of."""


def _report_folder(path: Path) -> None:
    found = faults(path.parent)
    if not found and path.read_bytes() != _WHOLE[path]:
        raise AssertionError("the damage was not noticed")


def _envelope(path: Path) -> None:
    key = Ed25519PrivateKey.from_private_bytes(bytes(32)).public_key()  # as in the samples
    files = {one.name: one.read_bytes() for one in path.parent.iterdir()}
    signed = not faults_of_signature(files, key)
    if signed and json.loads(files[path.name])["payload"] != json.loads(_WHOLE[path])["payload"]:
        raise AssertionError("a signature of another statement")


def _log(path: Path) -> None:
    log.read(path)


def _results(path: Path) -> None:
    results_folder.load(path.parent)


def _ledger(path: Path) -> None:
    claims.ledger(path.parent.parent)


def _minari(path: Path) -> None:
    _whole(read_minari(path.parent))


def _checkpoint(path: Path) -> None:
    """Restore the state of the run of the samples."""
    _, history = fit.load_checkpoint(path, FINGERPRINT, untrained_runs())
    if any(len(column) != len(history.updates) for column in history.values.values()):
        raise AssertionError("values without updates")


def _answers(path: Path) -> None:
    """Let a policy in a process answer with the file's lines."""
    lines = path.read_bytes().split(b"\n")

    class Child(process.Child):
        def __init__(self, *_: object) -> None:  # starts no process
            pass

        def exchange(self, line: bytes, seconds: float, most: int) -> bytes:
            return lines.pop(0)[:most] if lines else b""

        def failure(self, fault: str) -> UserError:
            return UserError(f"the process {fault}; correct it")

        def close(self) -> None:
            pass

    before = process.Child
    process.Child = Child
    try:
        world = Interface(GRID.n_features, GRID.n_actions)
        policy, details, _ = process.start_process("true", "a process", world, process.Limits())
        json.dumps(details)
        policy.predict(np.zeros((2, GRID.n_features), np.float32), deterministic=True)
    finally:
        process.Child = before


_OF_HDF5 = (
    Reader("steps, D4RL", "steps.hdf5", _steps),
    Reader("Minari, data", "minari/data/main_data.hdf5", _minari, beside=True),
    Reader("Minari, metadata", "minari/data/metadata.json", _minari, beside=True),
)

READERS = (
    Reader("policy", "policy.safetensors", _policy, resealed=True),
    Reader("policy, own", "policy.safetensors", _own_policy, resealed=True),
    Reader("ensemble", "ensemble.safetensors", _policy, resealed=True),
    Reader("dial", "dial.safetensors", _policy, resealed=True),
    Reader("dial, own", "dial.safetensors", _own_dial, resealed=True),
    Reader("dial with a rule", "context.safetensors", _policy, resealed=True),
    Reader("rule of the angle", "rule.toml", _rule),
    Reader("table", "table.safetensors", _policy, resealed=True),
    Reader("Stable-Baselines3", "dqn_intersection.zip", _foreign),
    Reader("ONNX", "dqn_intersection.onnx", _foreign),
    Reader("answers of a process", "answers.jsonl", _answers),
    Reader("demonstrations", "steps.safetensors", _demonstrations, resealed=True),
    Reader("steps, npz", "steps.npz", _steps),
    Reader("steps, csv", "steps.csv", _steps),
    *([Reader("steps, parquet", "steps.parquet", _steps)] if PARQUET else []),
    Reader("trajectories, npz", "rollouts.npz", _rollouts),
    Reader("trajectories, csv", "rollouts.csv", _rollouts),
    *(_OF_HDF5 if MINARI else ()),
    Reader("recording", "recording.safetensors", _recording, resealed=True),
    Reader("recording with lights", "lit.safetensors", _recording, resealed=True),
    Reader("CommonRoad with lights", "lit.xml", _commonroad),
    Reader("recorded world", "world.safetensors", _recorded_world, resealed=True),
    Reader("CommonRoad", "recording.xml", _commonroad),
    Reader("map", "recording.xml", road_of),
    Reader("CSV recording, own map", "mine.csv", _mine),
    Reader("inD, tracks", "ind/0_tracks.csv", _ind, beside=True),
    Reader("inD, meta", "ind/0_tracksMeta.csv", _ind, beside=True),
    Reader("inD, recording", "ind/0_recordingMeta.csv", _ind, beside=True),
    *(
        Reader(f"SinD, {name}", f"sind/made_{name}.csv", _sind, beside=True)
        for name in ("Ped_smoothed_tracks", "Veh_smoothed_tracks", "Traffic_Lights")
    ),
    Reader("column map", "columns.toml", _columns),
    Reader("declaration", "profile.toml", profiles.load),
    Reader("sweep", "sweep.toml", read_plan, beside=False),
    Reader("checkpoint", "checkpoint.safetensors", _checkpoint, resealed=True),
    Reader("scheduler file", "scheduler.json", scheduler_address),
    Reader("report", "report/report.json", _report),
    Reader("report, folder", "report/report.json", _report_folder, beside=True),
    Reader("report, episodes", "report/episodes.csv", _report_folder, beside=True),
    Reader("report, manifest", "report/MANIFEST.sha256", _report_folder, beside=True),
    Reader("report, statement", "report/statement.intoto.json", _report_folder, beside=True),
    Reader("report, envelope", "signed/statement.dsse.json", _envelope, beside=True),
    Reader("audit log", "log.jsonl", _log),
    Reader("nonce", "nonce.json", read_nonce),
    Reader("beacon's round", "round.json", read_round),
    Reader("private key", "private.pem", read_private_key),
    Reader("public key", "public.pem", read_public_key),
    Reader("results, config", "results/config.json", _results, beside=True),
    Reader("results, summary", "results/summary.json", _results, beside=True),
    Reader("results, table", "results/agreement.csv", _results, beside=True),
    Reader("JSON", "evaluation.json", read_json),
)
"""All of them."""


def place_of(reader: Reader, ok: Path, work: Path) -> Path:
    """Return where a reader's damaged file is written, with the files that belong to it."""
    sample = ok / reader.sample
    folder = work / reader.name.replace(" ", "-").replace(",", "")
    if not folder.exists():
        if reader.beside:
            shutil.copytree(sample.parent, folder)
        else:
            folder.mkdir(parents=True)
            if reader.name == "sweep":
                shutil.copy(ok / "steps.safetensors", folder)
    place = folder / sample.name
    _WHOLE[place] = sample.read_bytes()
    return place


def content_of(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any], str, int]:
    """Return arrays, header, kind and version of a file with a hash."""
    import safetensors

    with safetensors.safe_open(path, framework="numpy") as file:
        header = json.loads(file.metadata()["socialiq"])["header"]
    kind, version = header["kind"], header["version"]
    arrays, full = load_arrays(path, kind, version)
    rest = {key: value for key, value in full.items() if key not in ("kind", "version", "sha256")}
    return arrays, rest, kind, version


def as_bytes(arrays: dict[str, np.ndarray]) -> bytes:
    """Return arrays as an .npz archive."""
    file = io.BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()
