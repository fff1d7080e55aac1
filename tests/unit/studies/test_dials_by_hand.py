"""Tables of the studies of dials, from rows by hand: regrets, families, tests, monotony."""

import dataclasses
import math

import numpy as np
import pytest

from socialiq.audit.evidence.outcomes import Outcomes
from socialiq.evaluation.measures import Episodes
from socialiq.results_folder import Results
from socialiq.social.angle import exact_weights
from socialiq.types import Ending
from socialiq_lab.intersection.rows import backward_steps, points_of, value_at
from socialiq_lab.registry import find
from studies.intersection import study as intersection
from studies.intersection_continuous import study as continuous
from studies.intersection_dial import study as dials
from studies.intersection_offline import study as offline
from studies.recorded_junction_practice import study as junction


def row(env, social, **columns):
    return columns | {"r_env": env, "r_social": social}


def test_a_value_is_the_score_at_an_angle():
    for angle in (0.0, 30.0, 90.0):
        direction = exact_weights(angle)
        assert value_at(row(2.0, -1.0), angle) == 2 * direction.env - direction.social
    np.testing.assert_array_equal(points_of([row(1, 2), row(3, 4)]), [[1, 2], [3, 4]])


@pytest.mark.parametrize(
    ("totals", "rise", "drop"),
    [
        ([(3, 0), (2, 1), (1, 2)], 0.0, 0.0),
        ([(3, 0), (3.5, 1), (1, 0.25)], 0.5, 0.75),
        ([(3, 0)], 0.0, 0.0),
    ],
)
def test_backward_steps_are_the_largest_in_the_wrong_direction(totals, rise, drop):
    assert backward_steps([row(*pair) for pair in totals]) == {
        "rise_r_env": rise,
        "drop_r_social": drop,
    }


CONFIG = find("intersection-dial").Config(
    seeds=(1, 2), key_angles=(0.0, 90.0), turned=(0.0, 45.0, 90.0), families=("agents", "dial")
)


def test_agents_drive_at_the_key_angles_alone_and_few_dials_plan():
    cells = list(dials.cells(CONFIG))
    assert [(seed, family) for seed, family, _ in cells] == [
        (1, "agents"), (1, "dial"), (2, "agents"), (2, "dial"),
    ]  # fmt: skip
    assert cells[0][2] == CONFIG.key_angles and cells[1][2] == CONFIG.turned
    families = ("timed", "planned", "foresight")
    more = dataclasses.replace(CONFIG, families=families, planned_seeds=1)
    assert [family for seed, family, _ in dials.cells(more) if seed == 2] == ["timed"]


def test_jobs_stand_after_their_inputs_and_agents_have_one_angle():
    families = ("foresight", "calibrated", "agents", "planned", "iterated", "timed", "scores")
    planned = dials.jobs(dataclasses.replace(CONFIG, families=families))
    known = set()
    for job in planned:
        assert known.issuperset(job.inputs), job.name
        known.add(job.name)
    by_name = {job.name: job for job in planned}
    agent = by_name["agents/90/2"].config
    assert (agent.structure.low, agent.structure.high, agent.check_angles) == (90.0, 90.0, (90.0,))
    assert by_name["evaluation/planned/1"].inputs == ("timed/1",)
    assert by_name["evaluation/foresight/1"].config.ahead == "lookahead"
    assert by_name["evaluation/calibrated/1"].inputs == ("calibrated/1",)
    assert by_name["scores/1"].config.structure.heads == "score"


def policies():
    return [
        row(env, social, family=family, seed=seed, asked=angle, regret=regret, arrival=0.5)
        for family, shift in (("agents", 0.0), ("dial", 0.5))
        for seed in (1, 2)
        for angle, env, social, regret in (
            (0.0, 3.0 - shift + seed / 10, 0.5 - shift, 2 * shift * seed + seed),
            (90.0, 0.5 - shift, 3.0 - shift, shift * seed),
        )
    ]


def test_families_are_summed_up_over_the_key_angles():
    agents, *_, last = dials._families(CONFIG, policies())
    assert (agents["mean_regret"], agents["worst_regret"]) == (0.5, 1.0)
    assert (agents["regret_0"], agents["regret_90"]) == (1.0, 0.0)
    assert last["family"] == "dial" and last["regret_0"] == 4.0
    assert agents["hypervolume"] > last["hypervolume"] >= 0.0
    assert (agents["angles"], agents["most_arrivals"], agents["rise_r_env"]) == (2, 0.5, 0.0)


def test_differences_are_paired_by_seed():
    families = dials._families(CONFIG, policies())
    found = {row["measure"]: row for row in dials._differences(CONFIG, families)}
    assert found["regret_0"]["mean"] == pytest.approx(1.5)  # of the dial less the agents
    assert found["regret_90"]["mean"] == pytest.approx(0.75)
    assert all(row["p_holm"] >= row["p"] for row in found.values())
    one = dataclasses.replace(CONFIG, seeds=(1,))
    of_one_seed = [row for row in policies() if row["seed"] == 1]
    assert dials._differences(one, dials._families(one, of_one_seed)) == []


def test_the_summary_has_means_over_seeds():
    tables = {"families": [], "policies": policies(), "differences": []}
    entry = dials._summary(CONFIG, tables)["policies"]["agents"]["0"]
    assert (entry["r_env"], entry["regret"], entry["seeds"]) == (
        pytest.approx(3.15),
        1.5,
        2,
    )


OFFLINE = find("intersection-offline").Config(
    seeds=(1, 2, 3),
    angles=(0.0,),
    method_angles=(0.0,),
    methods=("clone weighted by R(α)", "IQ-Learn", "clone of all"),
)


def values_by_method(**methods):
    return [
        {"method": method, "seed": seed, "asked": 0.0, "value": value}
        for method, values in methods.items()
        for seed, value in enumerate(values, start=1)
    ]


def test_the_offline_dial_is_compared_with_the_best_demonstrator_and_the_methods():
    demonstrators = [
        {"method": f"demonstrator {mode}", "seed": "", "asked": 0.0, "value": value}
        for mode, value in (("egoistic", 1.0), ("prosocial", 2.0))
    ]
    methods = {
        "offline dial": (3.0, 3.1, 2.9),
        "clone weighted by R(α)": (1.0, 1.2, 1.1),
        "IQ-Learn": (3.5, 3.4, 3.6),
        "clone of all": (3.0, 3.0, 3.0),
    }
    found = offline.compared(OFFLINE, demonstrators + values_by_method(**methods))
    best, *others = found["differences"]
    assert best["other"] == "demonstrator prosocial" and best["mean"] == pytest.approx(1.0)
    assert [row["other"] for row in others] == list(OFFLINE.methods)
    assert [row["mean"] for row in others] == pytest.approx([1.9, -0.5, 0.0])
    (form,) = found["forms"]
    assert (form["form"], form["other"]) == ("IQ-Learn", "clone weighted by R(α)")
    assert form["mean"] == pytest.approx(2.4)
    summary = offline.summarised(found)
    assert summary["against_best_demonstrator"] == {"0": "above"}
    alone = dataclasses.replace(OFFLINE, seeds=(1,))
    assert offline.compared(alone, demonstrators) == {"differences": [], "forms": []}


def test_values_are_drawn_above_the_best_demonstrator():
    tables = {
        "policies": [
            {"method": "demonstrator egoistic", "seed": "", "asked": 0.0, "value": 2.0},
            {"method": "offline dial", "seed": 1, "asked": 0.0, "value": 2.5},
        ]
    }
    (drawn,) = offline.above_best(Results("intersection-offline", {}, tables, {}, {}))
    assert drawn["above"] == 0.5 and drawn["method"] == "offline dial"


def continuous_dials():
    return [
        row(env + seed / 10, social, kind=kind, seed=seed, asked=angle, value=env, regret=1.0)
        for kind, better in ((continuous.CONTINUOUS, 0.0), (continuous.DISCRETE, 1.0))
        for seed in (0, 1)
        for angle, env, social in ((0.0, 2.0 + better, 0.0), (90.0, 0.0, 2.0))
    ]


def test_dials_of_each_kind_are_summed_up_and_compared():
    families = continuous._families(continuous_dials())
    assert [(row["kind"], row["seed"]) for row in families] == [
        (kind, seed) for kind in (continuous.CONTINUOUS, continuous.DISCRETE) for seed in (0, 1)
    ]
    assert families[0]["value_0"] == 2.0 and families[2]["mean_value"] == 1.5
    assert families[0]["mean_regret"] == 1.0 and families[0]["rise_r_env"] == 0.0
    rows = families + [row | {"kind": continuous.HIGH_ANGLES} for row in families[:2]]
    found = {(row["kinds"], row["measure"]): row for row in continuous._differences(rows)}
    assert found["continuous less discrete", "value_0"]["mean"] == pytest.approx(-1.0)
    assert found["high-angles less continuous", "value_0"]["mean"] == 0.0


def test_a_policy_without_an_angle_is_valued_at_all():
    names = ("expert egoistic", "egoistic", "baseline")
    policies = [row(1.0, 3.0, name=name, seed=7, value=0.0) for name in names]
    rows = continuous._of_mixture(policies)
    assert [(row["method"], row["asked"]) for row in rows] == [
        ("IQ-Learn", 0.0), ("baseline", 0.0), ("baseline", 45.0), ("baseline", 90.0),
    ]  # fmt: skip
    assert rows[-1]["value"] == 3.0 and rows[0]["value"] == 1.0


def test_a_policy_is_best_at_a_range_of_angles():
    rows = [
        row(env, social, policy=name, readout="greedy", angle=0.0)
        for name, env, social in (
            ("a", 2.0, 0.0), ("b", 0.0, 2.0), ("c", 0.5, 0.5), ("d", -1.0, -1.0),
        )
    ]  # fmt: skip
    first, second, third, _ = intersection.best_angles(rows)
    assert first["best_to"] == pytest.approx(45.0) == second["best_from"]
    assert (third["best_from"], third["best_to"]) == ("", "")


SLOPE = math.tan(math.radians(6.0))


def test_angles_are_averaged_on_the_ring():
    rows = [row(-1.0, social, angle=angle) for social, angle in ((SLOPE, 174.0), (-SLOPE, -174.0))]
    mean = intersection._mean(rows)
    assert abs(mean["angle"]) == pytest.approx(180.0)
    assert mean["angle_high"] - mean["angle_low"] == pytest.approx(12.0)
    assert mean["seeds"] == 2 and mean["r_env"] == -1.0


def outcomes(totals, endings):
    count = len(totals)
    env, social = np.array(totals, float).T
    columns = {"ending": np.array(endings), "contact": np.zeros(count), "length": np.ones(count)}
    return Outcomes("a", Episodes(columns, r_env=env, r_social=social))


def test_drivers_at_the_junction_are_averaged_over_episodes_and_seeds():
    first = outcomes([(1, 0), (3, 0)], [Ending.ARRIVAL, Ending.TIMEOUT])
    second = outcomes([(3, 2), (5, 2)], [Ending.ARRIVAL, Ending.OTHER])
    found = junction._row("dial", [first, second])
    assert (found["r_env"], found["r_env_least"], found["r_env_largest"]) == (3.0, 2.0, 4.0)
    half = 1.96 * np.std([2.0, 4.0], ddof=1) / np.sqrt(2)
    assert found["r_env_high"] - found["r_env"] == pytest.approx(half)
    assert (found["arrival"], found["timeout"], found["closed_line"]) == (0.5, 0.25, 0.25)


def test_a_turn_is_paired_by_episode_from_the_first_angle_to_the_last():
    ends = [Ending.ARRIVAL] * 3
    slow, fast = outcomes([(1, 0), (2, 0), (3, 0)], ends), outcomes([(3, 1), (4, 1), (5, 1)], ends)
    env, social = junction._turns("recorded", {0.0: [slow], 45.0: [slow], 90.0: [fast]})
    assert (env["difference"], env["least"], env["largest"]) == (2.0, 2.0, 2.0)
    assert social["reward"] == "r_social" and social["difference"] == 1.0
