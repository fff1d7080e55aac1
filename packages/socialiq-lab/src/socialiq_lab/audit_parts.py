"""Episodes of an audit in parts, by seed, as jobs of the engine; the same evidence as in one."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from socialiq.audit.evidence.consistency import Consistency, joined
from socialiq.audit.evidence.drive import SIDE_BY_SIDE
from socialiq.audit.evidence.outcomes import Evidence, Outcomes
from socialiq.audit.profile.reader import load
from socialiq.audit.request import Collection, Request
from socialiq.audit.resolve_policy import Trust, resolve_policy
from socialiq.audit.verdict.shift import other_traffic
from socialiq.errors import UserError
from socialiq.policies.isolation import IsolationMode
from socialiq.policies.process import Limits
from socialiq.storage import load_arrays, save_arrays
from socialiq.to_json import to_json
from socialiq.types import RewardPair
from socialiq_lab.engine import Engine, run_jobs
from socialiq_lab.jobs import Job, ProgressCallback
from socialiq_lab.study import StageCallback

_KIND, _VERSION, _FILE = "audit-part", 2, "part.safetensors"
# In the order of the fields of `Outcomes`.
_COLUMNS = ("totals", "ending", "contact", "length")


@dataclass(frozen=True)
class PartConfig:
    """Configuration of a part of a collection: some of its episodes.

    Attributes:
        policy: As `Request.policy`.
        sha256: SHA-256 of the policy.
        profile: Absolute path of the declaration.
        profile_sha256: SHA-256 of the declaration.
        references: As `Request.references`.
        reference_sha256: SHA-256 of each reference that is a file, else "".
        soft: As `Request.soft`.
        allow_code: As `Trust.allow_code`.
        limits: As `Trust.limits`.
        isolation: As `Trust.isolation`.
        files: As `Trust.files`.
        traffic: As `Collection.traffic`.
        side_by_side: Number of episodes at once, the same for every part.
        seeds: Seeds of this part's episodes.
    """

    policy: str
    sha256: str
    profile: str
    profile_sha256: str
    references: tuple[str, ...]
    reference_sha256: tuple[str, ...]
    soft: bool
    allow_code: bool
    limits: Limits
    isolation: IsolationMode
    files: tuple[str, ...]
    traffic: int | None
    side_by_side: int
    seeds: tuple[int, ...]


def collector(
    engine: Engine, work: Path, on_stage: StageCallback, parts: int = 0
) -> Callable[[Collection], Evidence]:
    """Return a function that collects evidence in parts, for `conduct`.

    Args:
        engine: Engine of the jobs.
        work: Folder of the jobs' folders.
        on_stage: Returns the progress callback of a stage, given its name.
        parts: Number of parts; by default one for each process, on a cluster one for each 1,000
            episodes.
    """

    def collect(collection: Collection) -> Evidence:
        collection.check_parts()
        count = parts or engine.parts(len(collection.seeds))
        jobs = jobs_of(collection, count)
        run_jobs(jobs, work, on_stage, engine.processes, engine.cluster)
        return _joined(collection, [_read(work / job.name) for job in jobs])

    return collect


def jobs_of(collection: Collection, parts: int) -> list[Job]:
    """Return the jobs of the parts of a collection."""
    request, record = collection.request, collection.loaded.record
    stage = "episodes" if collection.traffic is None else f"traffic-{collection.traffic}"
    blocks = np.array_split(collection.seeds, parts)
    return [
        Job(
            f"{stage}/{number:04d}-of-{parts:04d}",
            play_part,
            PartConfig(
                policy=request.policy,
                sha256=record.sha256,
                profile=str(request.profile.absolute()),
                profile_sha256=collection.profile.sha256,
                references=request.references,
                reference_sha256=tuple(map(_sha256, request.references)),
                soft=request.soft,
                allow_code=request.trust.allow_code,
                limits=request.trust.limits,
                isolation=request.trust.isolation,
                files=request.trust.files,
                traffic=collection.traffic,
                side_by_side=min(SIDE_BY_SIDE, len(collection.seeds)),
                seeds=tuple(block.tolist()),
            ),
            cost=float(len(block)),
        )
        for number, block in enumerate(blocks)
    ]


def _sha256(reference: str) -> str:
    path = Path(reference)
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def play_part(
    config: PartConfig, folder: Path, _: Mapping[str, Path], __: ProgressCallback
) -> None:
    """Run all drivers on the episodes of a part, and write the evidence.

    Raises:
        UserError: If policy or declaration have changed since the commitment.
    """
    profile = load(Path(config.profile))
    limits = Limits(*config.limits)
    trust = Trust(config.allow_code, limits, config.isolation, tuple(config.files))
    world = profile.world(config.allow_code)
    place = world if config.traffic is None else other_traffic(profile)[config.traffic].world
    request = Request(
        config.policy,
        Path(config.profile),
        len(config.seeds),
        references=config.references,
        soft=config.soft,
        trust=trust,
    )
    with contextlib.ExitStack() as closing:
        loaded = closing.enter_context(resolve_policy(config.policy, world, profile.angle, trust))
        found = (loaded.record.sha256, profile.sha256)
        if found != (config.sha256, config.profile_sha256):
            raise UserError("policy or declaration have changed since the audit began")
        seeds = np.array(config.seeds, np.int64)
        collection = Collection.of(request, profile, config.traffic, place, loaded, closing)
        evidence = collection.on(seeds).collect(config.side_by_side)
    _write(evidence, folder)


def _write(evidence: Evidence, folder: Path) -> None:
    drivers = evidence.drivers
    arrays = {
        f"{number}/{column}": getattr(one, column)
        for number, one in enumerate(drivers)
        for column in _COLUMNS
    }
    save_arrays(
        folder / _FILE,
        _KIND,
        _VERSION,
        {**arrays, "seeds": evidence.seeds},
        {
            "scenario": evidence.scenario,
            "references": len(evidence.references),
            "drivers": [
                {"name": one.name, "angles": one.angles, "expected": one.expected}
                for one in drivers
            ],
            "strata": {name: labels.tolist() for name, labels in evidence.strata.items()},
            "consistency": to_json(evidence.consistency),
        },
    )


def _read(folder: Path) -> Evidence:
    arrays, header = load_arrays(folder / _FILE, _KIND, _VERSION)
    drivers = [
        Outcomes(
            one["name"],
            *(arrays[f"{number}/{column}"] for column in _COLUMNS),
            angles=tuple(one["angles"]),
            expected=None if one["expected"] is None else RewardPair(*one["expected"]),
        )
        for number, one in enumerate(header["drivers"])
    ]
    return Evidence(
        scenario=header["scenario"],
        seeds=arrays["seeds"],
        policy=drivers[0],
        references=tuple(drivers[1 : 1 + header["references"]]),
        strata={name: np.array(labels) for name, labels in header["strata"].items()},
        trivial=tuple(drivers[1 + header["references"] :]),
        consistency=Consistency.of(header["consistency"]),
    )


def _joined(collection: Collection, parts: Sequence[Evidence]) -> Evidence:
    """Join the columns of the parts, whose episodes are in the order of the seeds."""
    columns = [one.drivers for one in parts]
    drivers = [_joined_outcomes(one) for one in zip(*columns, strict=True)]
    if collection.world.is_exact:
        # Angles and expectations of the exact optima are computed here: their last bits depend on
        # the number of threads of a process.
        first = collection._replace(seeds=collection.seeds[:1]).collect()
        drivers = [
            replace(one, angles=own.angles, expected=own.expected)
            for one, own in zip(drivers, first.drivers, strict=True)
        ]
    count = 1 + len(parts[0].references)
    return Evidence(
        scenario=parts[0].scenario,
        seeds=collection.seeds,
        policy=drivers[0],
        references=tuple(drivers[1:count]),
        strata={
            name: np.concatenate([one.strata[name] for one in parts]) for name in parts[0].strata
        },
        trivial=tuple(drivers[count:]),
        consistency=joined([one.consistency for one in parts]),
    )


def _joined_outcomes(parts: Sequence[Outcomes]) -> Outcomes:
    return replace(
        parts[0],
        **{name: np.concatenate([getattr(one, name) for one in parts]) for name in _COLUMNS},
    )
