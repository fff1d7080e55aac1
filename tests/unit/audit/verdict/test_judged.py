"""All evidence together: references that are the policy itself, and other traffic."""

import numpy as np
import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.outcomes import Reference, episode_seeds
from socialiq.audit.verdict.results import results_of
from socialiq.audit.verdict.shift import other_traffic
from socialiq.audit.verdict.verdict import judge


class Always:
    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(len(observation), 1), state


@pytest.fixture(scope="module")
def profile(declared):
    return declared("crossing7", 0.0)


def evidence(world, purpose):
    itself = Reference("the same", Always(), 30.0)
    return collect_evidence(world, Always(), episode_seeds(purpose, 40), [itself])


def test_the_policy_itself_is_a_point_of_the_curve_but_no_reference(profile):
    found = evidence(profile.world(), 1)
    verdict, discrimination, shifts = results_of(profile, found, ["the same"], 5)
    assert shifts is None
    assert "the same" not in {one.name for one in discrimination.drivers}
    assert "the same" not in {one.name for one in verdict.regret.references}
    assert "the same" in {one.name for one in verdict.calibration.curve}
    assert verdict == judge(profile, found.without(["the same"]), 5, curve=found)


def test_other_traffic_is_compared_without_the_policy_itself(profile):
    traffic = other_traffic(profile)
    there = [evidence(one.world, 2) for one in traffic]
    found = results_of(profile, evidence(profile.world(), 1), ["the same"], 5, traffic, there)
    assert found.shifts is not None
    assert [one.name for one in found.shifts] == [one.name for one in traffic]
    assert all(one.best != "the same" for one in found.shifts)
