"""Evidence as a table: it reads back exactly, and nothing else is read."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialiq.audit.evidence.outcomes import COLUMNS, Evidence
from socialiq.audit.evidence.table import (
    ReferenceAttributes,
    kind_of_ending,
    read_table,
    write_table,
)
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair
from socialiq.worlds.highway.options import Contact

COLLISION = int(Ending.COLLISION)


@pytest.fixture
def made(outcomes, evidence):
    """Three episodes of every kind of ending, with names that need care."""
    rewards = [[0.1 + 0.2, -0.0], [1e-300, 1e11], [-1 / 3, 5.0]]
    policy = outcomes("policy", rewards, [1, COLLISION, COLLISION], [0, 1, 2])
    first = outcomes("=SUM(a).r_env", rewards[::-1], [3, 4, COLLISION], [0, 0, 0], angles=(15.0,))
    second = outcomes("'quoted', \"name\"", rewards, expected=RewardPair(0.1, 1 / 7))
    labels = {"density": np.array(["0 to 1", "4 or more", "0 to 1"])}
    return evidence(policy, first, second, **labels)


def attributes(evidence):
    return {one.name: ReferenceAttributes(one.angles, one.expected) for one in evidence.references}


def read(evidence, content):
    trivial, beside = [one.name for one in evidence.trivial], evidence.policy.measured
    described = evidence.scenario, evidence.policy.name, attributes(evidence), trivial
    return read_table(content, *described, beside)


def assert_equal(one, other):
    np.testing.assert_array_equal(one.seeds, other.seeds)
    assert one.strata.keys() == other.strata.keys()
    for name, labels in one.strata.items():
        np.testing.assert_array_equal(labels, other.strata[name])
    assert len(one.trivial) == len(other.trivial)
    pairs = zip(one.drivers, other.drivers, strict=True)
    for left, right in pairs:
        assert (left.name, left.angles, left.expected) == (right.name, right.angles, right.expected)
        assert left.measured == right.measured
        for column in (*COLUMNS, *left.measured):
            a, b = left.episodes[column], right.episodes[column]
            assert a.tobytes() == b.tobytes() and a.dtype == b.dtype, (left.name, column)


def test_everything_reads_back_to_the_bit(made):
    assert_equal(made, read(made, write_table(made).encode()))


def test_effects_read_back_to_the_bit_and_an_event_is_0_or_1(outcomes, evidence):
    beside = {"delay": np.array([0.1 + 0.2, -700.5]), "gap_below_1_s": np.array([0.0, 1.0])}
    one, other = (outcomes(name, np.zeros((2, 2)), beside=beside) for name in ("policy", "other"))
    made = evidence(one, other)
    text = write_table(made)
    assert_equal(made, read(made, text.encode()))
    for forged in (text.replace(",1.0", ",0.5"), text.replace("-700.5", "nan")):
        with pytest.raises(UserError, match="that is no audit's"):
            read(made, forged.encode())


def test_an_audit_reads_back(audited_evidence):
    found = read(audited_evidence, write_table(audited_evidence).encode())
    assert_equal(audited_evidence, found)


@pytest.fixture(scope="module")
def audited_evidence():
    from socialiq.audit.evidence.collect import collect_evidence
    from socialiq.audit.seeds import episode_seeds
    from socialiq.worlds.intersection.options import Options
    from socialiq.worlds.intersection.policies import policy
    from socialiq.worlds.intersection.world import Intersection

    world = Intersection(Options(duration=6.0))
    return collect_evidence(world, policy("gap_2s"), episode_seeds(3, 40))


@settings(max_examples=50)
@given(
    st.lists(
        st.tuples(*[st.floats(-1e12, 1e12)] * 4, st.integers(0, 2**62)), min_size=1, max_size=5
    ),
    st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1),
)
def test_any_numbers_and_any_name_read_back(outcomes, rows, name):
    numbers = np.array([row[:4] for row in rows])
    length = np.arange(len(rows))
    drivers = [
        outcomes(title, numbers[:, at]).with_columns(length=length)
        for title, at in (("policy", slice(0, 2)), (f"a {name}", slice(2, 4)))
    ]
    seeds = np.array([row[4] for row in rows])
    evidence = Evidence("made up", seeds, drivers[0], (drivers[1],), {})
    assert_equal(evidence, read(evidence, write_table(evidence).encode()))


def test_no_name_is_a_formula_for_a_spreadsheet(made):
    head = next(csv.reader(io.StringIO(write_table(made))))
    assert not any(name.startswith(("=", "+", "-", "@")) for name in head)


def test_a_contact_without_a_collision_is_not_kept(outcomes, evidence):
    """No criterion depends on it."""
    policy = outcomes("policy", [[0, 0]], [Ending.ARRIVAL], [Contact.EGO_STRUCK])
    found = evidence(policy, outcomes("other", [[0, 0]]))
    assert kind_of_ending(policy, 0) == "arrival"
    assert read(found, write_table(found).encode()).policy.episodes.contact.tolist() == [
        Contact.NONE
    ]


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("episode,seed", "episode,grain", "its columns are others"),
        ("policy.r_env", "policy.r_Env", "no column policy.r_env"),
        ("policy.ending", "policy.decisions", "its columns are others"),
        ("\n0,0", "\n1,0", "not written as an audit writes it"),
        ("arrival", "salvation", "salvation"),
        ("0.30000000000000004", "0.300000000000000040", "not written as an audit"),
        ("0.30000000000000004", "nan", "no audit's"),
        ("0.30000000000000004", "1e13", "no audit's"),
        ("0.30000000000000004", "x", "could not convert"),
        ("\n0,0", "\n0,9223372036854775808", "not a table of episodes"),
        ("\n0,0", "\n0,0,0", "row 1 has 16 columns, not 15"),
        ("\n0,0", "\r\n0,0", "not written as an audit writes it"),
        ("0 to 1", "0 to 1\x00", "not written as an audit writes it"),
        ("timeout,1", "timeout,one", "invalid literal"),
        ('"name""', '"name"', "not a table"),
    ],
)
def test_what_an_audit_does_not_write_is_refused(made, old, new, why):
    text = write_table(made)
    assert old in text
    with pytest.raises(UserError, match=why):
        read(made, text.replace(old, new, 1).encode())


@pytest.mark.parametrize("content", [b"", b"\xff", b"\n", b"episode,seed\n", b'"' * 7])
def test_what_is_no_table_is_refused(made, content):
    with pytest.raises(UserError, match="not a table of episodes"):
        read(made, content)


def test_a_table_needs_episodes_and_every_reference_once(made):
    text = write_table(made)
    with pytest.raises(UserError, match="no episodes"):
        read(made, text[: text.index("\n") + 1].encode())
    more = {**attributes(made), "another": ReferenceAttributes()}
    with pytest.raises(UserError, match="no columns of another"):
        read_table(text.encode(), "made up", "policy", more)
    fewer = dict(list(attributes(made).items())[:1])
    with pytest.raises(UserError, match="not a table"):
        read_table(text.encode(), "made up", "policy", fewer)


def test_trivial_drivers_follow_the_references_and_stay_apart(audited_evidence):
    text = write_table(audited_evidence).encode()
    trivial = [one.name for one in audited_evidence.trivial]
    assert trivial
    described = (audited_evidence.scenario, "policy", attributes(audited_evidence))
    assert len(read_table(text, *described, trivial).trivial) == len(trivial)
    with pytest.raises(UserError, match="not a table of episodes"):
        read_table(text, *described)
    more = described[2] | {trivial[0]: ReferenceAttributes()}
    swapped = read_table(text, *described[:2], more, trivial[1:])
    assert swapped.references[-1].name == trivial[0]
