"""A report recomputed from its table of episodes."""

import copy
import json

import pytest

from socialiq.audit.report.folder import evidence_path, files_of
from socialiq.audit.report.recompute import recomputed, recomputed_differences
from socialiq.errors import UserError


@pytest.fixture(scope="module")
def files(report, audited):
    return files_of(report, audited.profile, [audited.evidence, *audited.elsewhere])


@pytest.fixture
def read(files):
    return json.loads(files["report.json"])


def test_the_report_follows_from_its_episodes_to_the_last_digit(files, read):
    fresh = json.loads(json.dumps(recomputed(files, read)))
    for name in ("timing", "versions", "machine"):
        del fresh[name], read[name]
    assert fresh == read
    assert recomputed_differences(files, {**read, "timing": 0, "versions": 0, "machine": 0}) == []


def test_every_number_of_the_report_is_recomputed(files, read):
    """A number that is changed is found, wherever it is, but for what the auditor claims."""
    claimed = ("timing", "versions", "machine", "command", "reference_files", "claims_of_auditor")
    places = [one for one in numbers(read) if one[0] not in claimed]
    assert len(places) > 300
    wrong = copy.deepcopy(read)
    for place in places:
        *above, last = place
        inner = at(wrong, above)
        inner[last] += 1
    fresh = recomputed(files, read)
    from socialiq.audit.report.recompute import differences

    found = set(differences(wrong, json.loads(json.dumps(fresh)), frozenset(), 1e-9))
    assert not {text(one) for one in places} - found


def numbers(value, place=()):
    """Places of all numbers."""
    below = value.items() if isinstance(value, dict) else enumerate(value)
    for name, one in below:
        if isinstance(one, dict | list):
            yield from numbers(one, (*place, name))
        elif isinstance(one, int | float) and not isinstance(one, bool):
            yield (*place, name)


def at(value, place):
    for step in place:
        value = value[step]
    return value


def text(place):
    return "report" + "".join(f"[{one}]" if isinstance(one, int) else f".{one}" for one in place)


def test_deciding_places_come_first(files, read):
    read["cloud"][0][0] += 1.0
    read["tests"]["regret"]["low"] += 1.0
    assert recomputed_differences(files, read) == ["report.tests.regret.low", "report.cloud[0][0]"]


def test_the_policy_is_that_of_the_commitment(files, read):
    read["policy"]["record"]["sha256"] = "cd" * 32
    with pytest.raises(UserError, match=r"the seeds in episodes.csv are not those"):
        recomputed_differences(files, read)


def test_only_the_policy_itself_is_left_out(files, read):
    """A reference that is better than the policy can't be set aside."""
    read["left_out"] = [read["references"].pop()]
    assert "report.left_out" in recomputed_differences(files, read)


def test_other_traffic_is_recomputed(files, read):
    read["shift"]["traffic"][0]["changes"][0]["change"] += 1.0
    assert recomputed_differences(files, read) == ["report.shift.traffic[0].changes[0].change"]
    read["shift"]["traffic"] *= 2
    with pytest.raises(UserError, match="the other traffic"):
        recomputed_differences(files, read)
    read["shift"] = None
    assert recomputed_differences(files, read) == []


@pytest.mark.parametrize("number", [0, 1])
def test_every_table_is_needed(files, read, number):
    path = evidence_path(number)
    with pytest.raises(UserError, match=f"{path} is missing"):
        recomputed_differences({name: files[name] for name in files if name != path}, read)
    with pytest.raises(UserError, match=f"{path}: it is not a table"):
        recomputed_differences({**files, path: b""}, read)


def test_the_world_is_the_declared_one(files, read):
    read["scenario"] = read["scenario"].replace("0.3", "0.0")
    with pytest.raises(UserError, match=r"the scenario in report\.json"):
        recomputed_differences(files, read)


def test_all_episodes_are_there(files, read):
    read["seeds"]["episodes"] -= 1
    with pytest.raises(UserError, match=r"episodes.csv has 60 episodes, not 59"):
        recomputed_differences(files, read)
