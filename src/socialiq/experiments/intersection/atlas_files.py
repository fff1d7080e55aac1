"""The atlas' files, made of a finished study: the policies that others start from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from socialiq.experiments.intersection.experts import policy_file
from socialiq.experiments.jobs import RECORD
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import read_json
from socialiq.to_json import rounded
from socialiq.types import Row
from socialiq.worlds.intersection import atlas

_SHOWN = ("collision", "arrival", "timeout", "speed_kmh", "stopped", "r_env", "r_social", "angle")


def files(
    study: str, members: Mapping[str, str], work: Path, rows: Mapping[tuple[str, str], Row]
) -> dict[str, bytes]:
    """Content of the atlas' files by path below the results folder.

    Args:
        study: Which made them.
        members: Name in the atlas, and the job's folder.
        work: Folder of the jobs.
        rows: What each policy does, by (job, readout).
    """
    found, entries = {}, {}
    for name, job in members.items():
        source = work / job / policy_file(job)
        file = f"{name}.safetensors"
        found[f"{atlas.FOLDER}/{file}"] = source.read_bytes()
        policy, record = QPolicy.load(source), read_json(work / job / RECORD)
        entries[name] = {
            "file": file,
            "sha256": policy.sha256,
            "made_by": f"socialiq reproduce {study}",
            "job": job,
            "config": record["config"],
            "inputs": record["inputs"],
            "greedy": {key: rows[job, "greedy"][key] for key in ("episodes", *_SHOWN)},
        }
    text = json.dumps(rounded(_manifest(entries)), indent=2) + "\n"
    return found | {f"{atlas.FOLDER}/{atlas.MANIFEST}": text.encode()}


def _manifest(entries: dict[str, Any]) -> dict[str, Any]:
    return {"kind": "atlas", "version": 1, "world": "intersection", "policies": entries}
