import numpy as np
import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.outcomes import episode_seeds
from socialiq.audit.profile.profile import Floor, Margin
from socialiq.audit.verdict.decision import Decision
from socialiq.audit.verdict.results import discriminate
from socialiq.audit.verdict.verdict import judge

OPEN = Floor(1.0, 1.0, 0.0, 1.0)


class Standing:
    """Chooses the first action: it never leaves."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.zeros(len(observation), np.int64), state


@pytest.fixture(scope="module")
def driven(declared):
    return collect_evidence(declared("crossing7").world(), Standing(), episode_seeds(1, 80))


def judged(declared, driven, margin, floor=OPEN, angle=0.0):
    profile = declared("crossing7", angle, margin=Margin(margin, 10.0), competence=floor)
    return discriminate(profile, driven, 0, resamples=200)


def test_each_is_judged_as_if_it_were_the_policy(declared, driven):
    found = judged(declared, driven, 1.0)
    by_name = {one.name: one for one in found.drivers}
    assert found.of == len(driven.references) + len(driven.trivial) == len(by_name)
    assert found.would_pass == sum(one.decision is Decision.PASS for one in found.drivers)
    assert 0 < found.would_pass < found.of
    assert {name for name, one in by_name.items() if one.trivial} == {
        "trivial_STOP",
        "trivial_FAST",
        "trivial_random",
    }
    # The policy of these episodes always stops, as `trivial_STOP` does.
    profile = declared("crossing7", 0.0, margin=Margin(1.0, 10.0), competence=OPEN)
    own = judge(profile, driven, 0, resamples=200)
    assert by_name["trivial_STOP"].decision is own.decision is Decision.FAIL
    assert not found.excludes_nothing


def test_a_margin_wider_than_every_return_excludes_nothing(declared, driven):
    found = judged(declared, driven, 1e6)
    assert found.would_pass == found.of and found.excludes_nothing


def test_a_floor_excludes_something_even_if_the_margin_does_not(declared, driven):
    found = judged(declared, driven, 1e6, Floor(0.05, 0.1, 0.8, 0.2))
    by_name = {one.name: one.decision for one in found.drivers}
    assert by_name["trivial_STOP"] is Decision.FAIL and by_name["trivial_FAST"] is Decision.PASS
    assert not found.excludes_nothing


def test_a_single_reference_has_none_to_be_compared_with(declared, evidence, outcomes):
    made = evidence(outcomes("policy", np.zeros((30, 2))), outcomes("a", np.ones((30, 2))))
    found = discriminate(declared("crossing7"), made, 0, resamples=200)
    assert (found.of, found.drivers, found.excludes_nothing) == (0, (), False)
