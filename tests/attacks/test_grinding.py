"""Grinding: an owner tries until it passes, by reruns, by seeds, or by a free byte of the profile.

The policy's true regret is beyond the margin in every test, so that each pass is a wrong one, which
happens in about one audit in twenty. The owner can simulate at home what a seed will give.
"""

import datetime
import hashlib
import itertools
import json

import jaxtyping
import pytest

from socialiq.audit.evidence.drive import Course
from socialiq.audit.evidence.outcomes import Reference
from socialiq.audit.look import draw
from socialiq.audit.profile.profile import Floor, Margin
from socialiq.audit.profile.reader import parse
from socialiq.audit.profile.template import declare
from socialiq.audit.seeds import Commitment, episode_seeds
from socialiq.cli.main import main
from socialiq.evaluation.exact import Optimum, evaluate_exactly
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import TabularPolicy, expert_policy

EPISODES = 100
NOON = datetime.datetime(2026, 1, 31, 12, tzinfo=datetime.UTC)
FLOOR = Floor(max_at_fault=0.95, max_struck=0.95, min_arrival=0.01, max_timeout=0.95)


class Owner:
    """An owner whose policy is slightly worse than its declaration."""

    def __init__(self, folder):
        whole = tabulate(make_grid("crossing7"))
        self.table = whole.reachable_part()
        self.policy, self.best = (
            TabularPolicy(whole.world, expert_policy(whole, angle, "stochastic"))
            for angle in (60.0, 0.0)
        )
        self.folder, self.file = folder, folder / "policy.safetensors"
        self.policy.save(self.file)
        self.sha256 = hashlib.sha256(self.file.read_bytes()).hexdigest()
        exact = evaluate_exactly(whole, self.policy.probabilities)
        self.margin = 0.99 * Optimum(whole).regret(exact, 0.0)
        day = datetime.date(2026, 1, 31)
        margin = Margin(self.margin, 90.0)
        self.profile = declare(0.0, "Grinder", "crossing7", margin, day, competence=FLOOR).source

    def would_pass(self, profile, seed):
        """Whether an audit with this seed would pass clearly, by the normal approximation."""
        declared = parse(profile, "profile.toml")
        drawn = draw(Commitment(self.sha256, declared.sha256), seed)
        course = Course(self.table.world, episode_seeds(drawn.derived("episodes"), EPISODES))
        best, mine = (
            course.drive(Reference("", one)).totals[:, 0] for one in (self.best, self.policy)
        )
        gain = best - mine
        return gain.mean() + 2.6 * gain.std() / EPISODES**0.5 <= self.margin

    def audit(self, out, *more, profile=None):
        """Return the status of an audit, and its report."""
        declared = self.folder / "profile.toml"
        declared.write_bytes(profile or self.profile)
        words = ["audit", str(self.file), "--profile", str(declared), "--out", str(out)]
        status = main([*words, "--episodes", str(EPISODES), *more])
        return status, json.loads((out / "report.json").read_bytes())


@pytest.fixture(scope="module")
def owner(tmp_path_factory):
    jaxtyping.config.update("jaxtyping_disable", True)
    yield Owner(tmp_path_factory.mktemp("owner"))
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="module")
def seed(owner):
    """The first seed with which the audit passes."""
    return next(seed for seed in itertools.count() if owner.would_pass(owner.profile, seed))


@pytest.fixture(scope="module")
def ground(owner):
    """The first declaration that passes with an announced seed: only a comment differs."""
    tried = (owner.profile + b"# %d\n" % number for number in itertools.count())
    return next(profile for profile in tried if owner.would_pass(profile, 7))


@pytest.fixture(scope="module")
def third(owner, seed, tmp_path_factory):
    """Folder of the reports and the log of an owner who passes at the third try, by itself."""
    folder = tmp_path_factory.mktemp("reruns")
    for number, one in enumerate((seed + 1, seed + 2, seed)):
        drawing(owner, one, folder / str(number))
    return folder


def drawing(owner, seed, out):
    """An audit for which the system's entropy happens to give a seed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("socialiq.audit.seeds.secrets.randbelow", lambda _: seed)
        return owner.audit(out)


def report_of(folder):
    return json.loads((folder / "report.json").read_bytes())


def test_a_rerun_that_would_pass_alone_is_told_to_be_a_rerun(owner, seed, third, tmp_path):
    alone, _ = owner.audit(tmp_path / "alone", "--seed", str(seed))
    assert alone == 0  # grinding has something to find
    report = report_of(third / "2")
    assert report["verdict"]["decision"] == "inconclusive"
    assert report["look"]["number"] == 3
    assert report["tests"]["regret"]["high"] > owner.margin


@pytest.mark.slow
def test_a_log_without_the_first_tries_is_found(third, tmp_path, capsys):
    (log,) = (third / "audit-log").glob("*.jsonl")
    words = ["audit", "verify", str(third / "2"), "--log"]
    assert main([*words, str(log)]) == 0
    lines = log.read_bytes().splitlines(keepends=True)
    for kept in (lines[3:], lines[:3] + lines[6:], lines[:6], lines[::-1]):
        shorter = tmp_path / log.name
        shorter.write_bytes(b"".join(kept))
        assert main([*words, str(shorter)]) in (1, 2)
    assert "log" in capsys.readouterr().err


def test_a_log_written_again_is_found_by_the_report(owner, third, seed, tmp_path):
    """The owner throws the log away and repeats the passing try as the first look."""
    status, _ = drawing(owner, seed, tmp_path / "again")
    assert status == 0
    (log,) = (tmp_path / "audit-log").glob("*.jsonl")
    assert main(["audit", "verify", str(third / "2"), "--log", str(log)]) == 1


def test_a_free_byte_finds_nothing_where_the_seed_is_a_nonce(
    owner, ground, tmp_path, capsys, monkeypatch
):
    status, report = owner.audit(tmp_path / "announced", "--seed", "7", profile=ground)
    assert status == 0  # grinding has something to find
    assert "knew it" in " ".join(one["text"] for one in report["caveats"])
    assert report["look"] is None and not (tmp_path / "audit-log").exists()
    with_log = ["--seed", "7", "--log", str(tmp_path / "log")]
    assert main(["audit", str(owner.file), *with_log, "--profile", "p", "--out", "o"]) == 2

    nonce, log = tmp_path / "nonce.json", str(tmp_path / "log")
    assert main(["audit", "nonce", "--out", str(nonce)]) == 0
    sha256 = capsys.readouterr().out.split()[0]
    # The seed comes from the nonce and the commitment's line, which has the time: one time in
    # forty it would be a lucky one.
    monkeypatch.setattr("socialiq.audit.log.now", lambda: NOON)
    nonce.write_text(json.dumps({"nonce": "11" * 32}))
    sha256 = hashlib.sha256(b"\x11" * 32).hexdigest()
    declared = owner.folder / "profile.toml"
    declared.write_bytes(ground)
    commit = ["audit", "commit", str(owner.file), "--profile", str(declared), "--log", log]
    commit += ["--episodes", str(EPISODES), "--nonce-sha256", sha256]
    assert main(commit) == 0
    more = ["--nonce", str(nonce), "--log", log]
    status, report = owner.audit(tmp_path / "revealed", *more, profile=ground)
    assert status == 3 and report["seeds"]["source"] == "auditor's nonce"
