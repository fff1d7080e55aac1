"""The report's content, and the schema that describes it."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from tests.unit.audit.report.conftest import Always

import socialiq.audit.report as package
from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.outcomes import CRITERIA, Reference
from socialiq.audit.profile.fields import SHA256_PATTERN
from socialiq.audit.report import verify as check
from socialiq.audit.report.content import content, results_of
from socialiq.audit.report.verify import fault_of, read_report
from socialiq.audit.report.words import plain_name
from socialiq.audit.seeds import LARGEST_SEED, episode_seeds
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.results import MEASURES
from socialiq.audit.verdict.verdict import judge
from socialiq.errors import UserError

SHIPPED = json.loads((Path(package.__file__).parent / "report.schema.json").read_text())


def places(value, path=()):
    """Every object of a schema'd document, with its path."""
    if isinstance(value, dict):
        yield path
        for name, one in value.items():
            yield from places(one, (*path, name))
    if isinstance(value, list) and value:
        yield from places(value[0], (*path, 0))


def at(value, path):
    for step in path:
        value = value[step]
    return value


FREE = (
    ("policy", "record"),
    ("declaration", "scenario", "options"),
    ("shift", "traffic", 0, "options"),
    ("versions",),
)


OPTIONAL = ("angle_rule", "contexts", "caused")
"""Properties of a report on a declared rule of the angle alone."""


def objects(schema):
    """Every object of a schema with named properties."""
    if isinstance(schema, list):
        for one in schema:
            yield from objects(one)
    if isinstance(schema, dict):
        if "properties" in schema:
            yield schema
        yield from objects(list(schema.values()))


def test_the_schema_is_valid_and_demands_every_property():
    Draft202012Validator.check_schema(SHIPPED)
    found = list(objects(SHIPPED))
    assert len(found) > 30
    for one in found:
        assert one["required"] == [name for name in one["properties"] if name not in OPTIONAL]
        assert one["additionalProperties"] == (one is SHIPPED["$defs"]["record"])


def test_the_schema_has_the_names_and_limits_of_the_code():
    defined = SHIPPED["$defs"]
    assert defined["criterion"]["enum"] == list(CRITERIA)
    assert defined["change"]["properties"]["measure"]["enum"] == list(MEASURES)
    assert defined["decision"]["enum"] == [one.value for one in Decision]
    assert defined["count"]["maximum"] == LARGEST_SEED
    assert defined["sha256"]["pattern"] == SHA256_PATTERN
    assert set(CRITERIA) < set(defined["driver"]["properties"])


def test_a_report_follows_the_schema(report):
    assert fault_of(report, SHIPPED) == ""
    json.dumps(report, allow_nan=False)


def test_no_field_may_be_missing_or_added(plain):
    for rows in (plain, plain["episodes"], plain["tests"]["regret"]):
        for name in ("cloud", "strata", "references", "median", "worst"):  # the rest is alike
            if name in rows:
                rows[name] = rows[name][:1]
    for path in [one for one in places(plain) if one[:2] != FREE[0] and one not in FREE]:
        spot = at(plain, path)
        for name in list(spot):
            kept = spot.pop(name)
            assert fault_of(plain, SHIPPED), (path, name)
            spot[name] = kept
        spot["strange"] = 1
        assert "unknown field" in fault_of(plain, SHIPPED), path
        del spot["strange"]
    assert fault_of(plain, SHIPPED) == ""


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("format",), 2),
        (("format",), True),
        (("verdict", "decision"), "good"),
        (("verdict", "episodes"), -1),
        (("verdict", "episodes"), True),
        (("hashes", "policy"), "AB" * 32),
        (("policy", "means", "arrival"), 1.5),
        (("cloud",), [[1.0]]),
        (("episodes", "worst"), {}),
        (("episodes", "worst", 0, "seed"), 5),
        (("limits",), [1]),
        (("references",), []),
        (("policy", "means", "r_env"), 1e300),
        (("policy", "means", "r_env"), float("inf")),
        (("shift", "traffic"), []),
        (("shift", "traffic", 0, "changes", 0, "measure"), "<script>"),
        (("seeds", "seed"), 2**53),
        (("seeds",), None),
        (("versions", "python"), 3),
    ],
)
def test_wrong_values_are_found(plain, path, value):
    at(plain, path[:-1])[path[-1]] = value
    assert fault_of(plain, SHIPPED)


def test_the_content_says_what_was_found(report, audited):
    (evidence, *_) = audited.evidence
    verdict = judge(audited.profile, evidence, audited.drawn.derived("resampling"))
    assert report["verdict"]["decision"] == verdict.decision.value
    assert (
        report["verdict"]["exit_code"]
        == {"pass": 0, "fail": 1, "inconclusive": 3}[verdict.decision.value]
    )
    assert report["tests"]["regret"]["regret"] == verdict.regret.regret
    assert report["policy"]["means"]["r_env"] == evidence.policy.totals[:, 0].mean()
    assert len(report["references"]) == len(evidence.references)
    assert sum(one["episodes"] for one in report["strata"]) == 60 * len(evidence.strata)
    assert report["hashes"]["profile"] == audited.profile.sha256


def test_worst_and_median_episodes(report, audited):
    own = np.sort(audited.evidence[0].policy.totals[:, 0])
    assert [one["value"] for one in report["episodes"]["worst"]] == own[:3].tolist()
    assert [one["value"] for one in report["episodes"]["median"]] == own[28:31].tolist()
    seeds = [str(seed) for seed in audited.evidence[0].seeds.tolist()]
    for one in report["episodes"]["worst"]:
        assert seeds[one["episode"]] == one["seed"]


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[]",
        b'{"format": NaN}',
        b"[" * 100_000,
        b'{"format": ' + b"9" * 5000 + b"}",
        b'{"machine": "\\ud800"}',
        b'{"machine": "\xff"}',
    ],
)
def test_what_is_no_report_is_refused_in_one_line(tmp_path, content):
    path = tmp_path / "report.json"
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"report\.json is no") as refusal:
        read_report(path)
    assert "\n" not in str(refusal.value)


def test_a_huge_report_is_not_parsed(tmp_path, monkeypatch):
    monkeypatch.setattr(check, "LARGEST_REPORT", 10)
    (tmp_path / "report.json").write_bytes(b"[1, 2, 3, 4]")
    with pytest.raises(UserError, match="more than 10 bytes"):
        read_report(tmp_path / "report.json")


def test_a_policy_that_answers_otherwise_when_asked_again_gets_a_caveat(audited):
    """Some answers follow the number of requests: the first screen says so."""

    def about(**fields):
        found = content(dataclasses.replace(audited, **fields))
        return [one["about"] for one in found["caveats"]]

    none = {kind: [None] * len(rows) for kind, rows in audited.traces.items()}
    assert "episodes" not in about()
    assert "episodes" in about(traces=none)
    assert "episodes" not in about(traces=none, deterministic=False)
    # Those that weaken the verdict most come first.
    assert [one for one in about(traces=none) if one in ("episodes", "look")] == [
        "episodes",
        "look",
    ]


def test_a_policy_that_drives_as_a_trivial_driver_is_named(audited):
    evidence, *others = audited.evidence
    trivial = evidence.trivial[0]
    changed = dataclasses.replace(evidence, policy=dataclasses.replace(trivial, name="policy"))
    found = content(dataclasses.replace(audited, evidence=(changed, *others)))
    (last,) = [row["text"] for row in found["caveats"] if row["about"] == "episodes"]
    assert last.startswith("The policy drove every episode exactly as a known driver")
    assert last.endswith(f"{plain_name(trivial.name)}.")


def alike(world, seed):
    """Evidence of a driver with itself among the references."""
    itself = Reference("the same", Always(), 30.0)
    return collect_evidence(world, Always(), episode_seeds(seed, 40), [itself])


def test_the_policy_itself_has_a_side_in_the_direction_but_is_no_reference(audited):
    profile = audited.profile
    found = alike(profile.world(), 1)
    changed = {"evidence": [found], "traffic": (), "left_out": ["the same"]}
    results = results_of(dataclasses.replace(audited, **changed))
    verdict, seed = results.verdict, audited.drawn.derived("resampling")
    assert results.shifts == ()
    assert "the same" not in {one.name for one in results.discrimination.drivers}
    assert "the same" not in {one.name for one in verdict.regret.references}
    assert "the same" not in {one.name for one in verdict.direction.sides}  # an optimum is first
    assert verdict == judge(profile, found.without(["the same"]), seed, directed=found)


def test_other_traffic_is_compared_without_the_policy_itself(audited):
    worlds = [audited.profile.world(), *(one.world for one in audited.traffic)]
    evidence = [alike(world, seed) for seed, world in enumerate(worlds)]
    changed = dataclasses.replace(audited, evidence=evidence, left_out=["the same"])
    found = results_of(changed).shifts
    assert found is not None
    assert [one.name for one in found] == [one.name for one in audited.traffic]
    assert all(one.best != "the same" for one in found)
