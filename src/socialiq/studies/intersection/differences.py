"""The thesis' claims of difference as tests: paired over training seeds, Holm within a family."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from socialiq.experiments.intersection.experts import expert_name
from socialiq.experiments.tables import paired_row, with_holm
from socialiq.studies.intersection.config import Config
from socialiq.studies.intersection.plan import TRAINED, learner_name
from socialiq.types import Row


class Comparison(NamedTuple):
    """Two policies and a metric that the thesis compares.

    Attributes:
        place: Where it does.
        first: A learner's target.
        second: Another learner's target, or "expert MODE".
        metric: Column of the policies' table.
    """

    place: str
    first: str
    second: str
    metric: str


_EGO = ("collision", "arrival", "timeout", "speed_kmh", "stopped")
_EXPOSED = ("at_fault_per_entry", "at_fault_per_conflict")

COMPARISONS = (
    *(Comparison("6.3, 7.2", "egoistic", "expert egoistic", metric) for metric in _EGO),
    *(Comparison("6.3, 7.2", "prosocial", "expert prosocial", metric) for metric in _EGO),
    Comparison("6.3", "altruistic", "expert altruistic", "collision"),
    *(Comparison("7.1", "prosocial", "egoistic", m) for m in ("collision", "arrival", "stopped")),
    *(Comparison("7.1", "altruistic", "prosocial", m) for m in ("collision", "arrival", "stopped")),
    *(Comparison("7.2", "prosocial", "expert prosocial", metric) for metric in _EXPOSED),
    *(Comparison("7.2", "egoistic", "expert egoistic", metric) for metric in _EXPOSED),
)


def differences(rows: Mapping[tuple[str, str], Row], config: Config) -> list[Row]:
    """Every comparison in every group of learners, on greedy episodes.

    A replicate is a training seed; an expert, trained once, is the same in all of them, so those
    tests tell how learners vary and not how experts would. A rate over nothing (no entry into the
    junction) leaves a comparison out.

    Args:
        rows: Of policies, by (policy, readout).
        config: Of the study.
    """
    found: list[Row] = []
    for preset, setting in TRAINED:
        family: list[Row] = []
        for one in COMPARISONS:
            first, second = (
                _values(rows, preset, setting, policy, one.metric, config)
                for policy in (one.first, one.second)
            )
            if "" in first or "" in second or len(first) < 2:
                continue
            label = {"preset": preset, "setting": setting} | one._asdict()
            family.append(paired_row(label, first, second))
        found += with_holm(family)
    return found


def _values(
    rows: Mapping[tuple[str, str], Row],
    preset: str,
    setting: str,
    policy: str,
    metric: str,
    config: Config,
) -> list[float]:
    """One value for each training seed."""
    if policy.startswith("expert "):
        mode = policy.removeprefix("expert ")
        name = expert_name("flat", mode, config.expert_seed)
        return [rows[name, "greedy"][metric]] * len(config.seeds)
    names = [learner_name(preset, setting, policy, seed) for seed in config.seeds]
    return [rows[name, "greedy"][metric] for name in names]
