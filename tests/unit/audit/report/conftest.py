import datetime

import numpy as np
import pytest

from socialiq.audit.evidence.collect import collect_evidence
from socialiq.audit.evidence.replay import selected, traces_of
from socialiq.audit.look import draw
from socialiq.audit.profile.profile import other_traffic
from socialiq.audit.report.content import Audited, content
from socialiq.audit.seeds import Commitment, episode_seeds
from socialiq.to_json import to_json

HOSTILE = "<script>alert(1)</script> | `x` [y](z)"
"""A name that a user might give to a policy, a file or an owner."""


class Always:
    """Chooses one action."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(len(observation), 1), state


def elsewhere(drawn, traffic):
    """Evidence of the same driver in other traffic."""
    return [
        collect_evidence(one.world, Always(), episode_seeds(drawn.derived(f"shift {number}"), 60))
        for number, one in enumerate(traffic)
    ]


@pytest.fixture(scope="package")
def audited(declared):
    """An audit in the smaller gridworld: the driver that always does the same."""
    profile = declared("crossing7", 0.0)
    drawn = draw(Commitment("ab" * 32, profile.sha256), 7)
    evidence = collect_evidence(
        profile.world(), Always(), episode_seeds(drawn.derived("episodes"), 60)
    )
    traffic = other_traffic(profile)
    there = elsewhere(drawn, traffic)
    return Audited(
        profile=profile,
        policy={
            "kind": "table",
            "source": HOSTILE,
            "sha256": "ab" * 32,
            "covers": "its bytes",
            "n_features": 5,
            "n_actions": 3,
            "soft": False,
            "isolation": {"kind": "not needed", "why": "a reason"},
        },
        deterministic=True,
        drawn=drawn,
        look=None,
        records={},
        reference_files=[],
        left_out=[],
        consistency=None,
        evidence=[evidence, *there],
        traffic=traffic,
        episodes=selected(evidence, 0.0),
        films={},
        traces=traces_of(profile.world(), Always(), selected(evidence, 0.0)),
        command=f"socialiq audit '{HOSTILE}' --profile p.toml --episodes 60 --seed 7",
        started=datetime.datetime(2026, 1, 31, 12, 0, tzinfo=datetime.UTC),
    )


@pytest.fixture(scope="package")
def report(audited):
    return content(audited)


@pytest.fixture
def plain(report):
    """A copy that a test may change."""
    return to_json(report)
