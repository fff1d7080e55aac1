import dataclasses

import jax
import numpy as np
import pytest

from socialiq.mdp.horizon import horizon_evaluation, horizon_optimum
from socialiq.types import Ending
from socialiq.worlds.enumerate import episode_range, tabulate
from socialiq.worlds.grid_world import Episode

N_STATES, N_KEYS = 150, 300


def simulated(world, states):
    """Next states and endings, (states, actions, keys, ...), and reward pairs."""

    def once(state, action, key):
        after, step = world.advance(key, Episode(state, 0), action)
        return after.state, step.ending, step.rewards

    over_keys = jax.vmap(once, in_axes=(None, None, 0))
    over_actions = jax.vmap(over_keys, in_axes=(None, 0, None))
    batched = jax.jit(jax.vmap(over_actions, in_axes=(0, None, None)))
    keys = jax.random.split(jax.random.key(1), N_KEYS)
    return jax.device_get(batched(states, np.arange(world.n_actions), keys))


def table_of(tabulated, case):
    name, options = case
    return tabulated(name, **options)


CASES = [
    ("crossing5", {}),
    ("crossing7", {}),
    ("crossing7", {"braking": "one_level", "spawn_probability": 0.6}),
    ("crossing7", {"second_slot_refills": "same_step", "first_slot": "once"}),
]


@pytest.fixture(scope="module", params=CASES, ids=str)
def sampled(request, tabulated):
    """A table, some of its states, and the results of the batched step."""
    table = table_of(tabulated, request.param)
    chosen = np.random.default_rng(0).choice(table.mdp.n_states, N_STATES)
    return table, chosen, simulated(table.world, table.states[chosen])


def test_table_equals_the_batched_step(sampled):
    table, chosen, (after, ending, rewards) = sampled
    index = table.world.index(after)
    mdp = table.mdp
    known = (each[chosen][:, :, None] for each in (mdp.successor, mdp.ending, mdp.probability))
    successor, kind, probability = known
    matches = (index[..., None] == successor) & (ending[..., None] == kind) & (probability > 0.0)
    assert matches.any(axis=-1).all()
    for found, exact in zip(rewards, table.mdp.rewards, strict=True):
        np.testing.assert_allclose(found, exact[chosen][:, :, None].repeat(N_KEYS, 2), atol=1e-6)


@pytest.mark.parametrize("sampled", CASES[1:], ids=str, indirect=True)
def test_frequencies_of_the_batched_step_match_the_probabilities(sampled):
    table, chosen, (after, _, _) = sampled
    first, second = np.moveaxis(table.mdp.successor[chosen], -1, 0)
    p = table.mdp.probability[chosen][..., 1]
    hits = (table.world.index(after) == second[..., None]).sum(axis=-1)
    apart = first != second
    assert apart.any() and not apart.all()
    assert (hits[~apart] == N_KEYS).all()
    errors = (hits - N_KEYS * p)[apart] / np.sqrt(N_KEYS * p * (1 - p))[apart]
    assert np.abs(errors).max() < 5.0


@pytest.mark.parametrize("case", CASES, ids=str)
def test_reachable_part_keeps_exact_evaluation(case, tabulated):
    table = table_of(tabulated, case)
    part, kept = table.reachable_part(), table.mdp.reachable()
    policy = np.random.default_rng(3).dirichlet(
        np.ones(table.mdp.n_actions), (table.world.horizon, table.mdp.n_states)
    )
    whole = horizon_evaluation(table.mdp, policy, table.world.horizon)
    small = horizon_evaluation(part.mdp, policy[:, kept], table.world.horizon)
    assert small.totals == pytest.approx(whole.totals, abs=1e-12)
    np.testing.assert_allclose(small.endings, whole.endings, atol=1e-12)
    np.testing.assert_allclose(small.visits, whole.visits[kept], atol=1e-12)


def test_reachable_part_keeps_each_states_columns(table7):
    part, kept = table7.reachable_part(), table7.mdp.reachable()
    np.testing.assert_array_equal(part.states, table7.states[kept])
    np.testing.assert_array_equal(part.speed, table7.speed[kept])
    for name, values in table7.signals.items():
        np.testing.assert_array_equal(part.signals[name], values[kept])


def test_an_impossible_outcome_may_lead_anywhere(table5):
    # the second outcome never happens and leads to states before any that is visited
    def rules(state, action, chance):
        outcome = table5.world.rules(state, action, 0)
        return outcome._replace(state=jax.numpy.where(chance == 1, state * 0 + 2, outcome.state))

    start = (((2, 2, 2, 4), 1.0),)
    world = dataclasses.replace(table5.world, rules=rules, chance=(1.0, 0.0), start=start)
    part = tabulate(world).reachable_part()
    assert part.states.tolist() == [[2, 2, 2, 4], [3, 2, 2, 4]]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_weighted_signals_are_the_rewards(case, tabulated):
    table = table_of(tabulated, case)
    world = table.world
    assert set(table.signals) == set(world.signal_names)
    sides = (world.env_weights, world.social_weights)
    for weights, reward in zip(sides, table.mdp.rewards, strict=True):
        weighted = sum(weight * table.signals[name] for name, weight in weights.items())
        np.testing.assert_array_equal(weighted, reward)


@pytest.mark.parametrize("p", [0.0, 0.3, 1 / 3])
def test_rewards_are_exact_in_float64(p, tabulated):
    rewards = tabulated("crossing7", spawn_probability=p).reachable_part().mdp.rewards
    assert set(rewards.env.ravel()) == {-0.3, 0.4 * 0.5 - 0.3, 0.4 - 0.3, 2.0}
    assert {0.2, -2.0} < set(rewards.social.ravel())
    # at most 0.2 for each of two vehicles, and whole or half speed levels lost
    lost = rewards.social[rewards.social <= 0.0]
    assert (lost * 2.0 == np.rint(lost * 2.0)).all()
    assert set(rewards.social[rewards.social > 0.0]) <= {0.2, 0.4}


def test_states_are_numbered_in_order(table7):
    world = table7.world
    np.testing.assert_array_equal(world.index(table7.states), np.arange(12_096))
    assert table7.states[0].tolist() == [0, 0, -1, 0, -1, 0]
    assert table7.states[-1].tolist() == [6, 2, 6, 2, 6, 2]
    assert table7.states[1].tolist() == [0, 0, -1, 0, -1, 1]
    assert table7.observe(np.arange(2), np.zeros(2, int)).dtype == np.float32


def test_first_states_have_their_probabilities(tabulated):
    table = tabulated("crossing7", second_slot_at_start="random")
    chances = {tuple(table.states[s].tolist()): p for s, p in enumerate(table.mdp.initial) if p}
    assert chances == {(0, 0, 0, 2, -1, 0): 0.7, (0, 0, 0, 2, 0, 2): 0.3}


def test_time_is_no_ending_of_the_table(table7):
    assert set(np.unique(table7.mdp.ending)) == {Ending.NONE, Ending.ARRIVAL}


def test_batched_resets_draw_the_first_states_by_their_probabilities(tabulated):
    table = tabulated("crossing7", second_slot_at_start="random")
    keys = jax.random.split(jax.random.key(5), 4000)
    episodes, observations = jax.device_get(jax.jit(jax.vmap(table.world.reset))(keys))
    np.testing.assert_array_equal(observations, episodes.state)
    assert (table.mdp.initial[table.world.index(episodes.state)] > 0.0).all()
    filled = (episodes.state[:, 4] == 0).mean()
    assert filled == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / 4000))


@pytest.mark.parametrize(("p", "second"), [(0.0, (-1, 0)), (1.0, (0, 2))])
def test_certain_spawns_are_certain_in_the_batched_step(p, second, tabulated):
    table = tabulated("crossing7", spawn_probability=p)
    start = table.world.index(table.world.start[0][0])
    after, _, _ = simulated(table.world, table.states[[start]])
    assert (after[..., 4:] == second).all()


def test_the_range_of_crossing5_by_hand(tabulated):
    """Waiting for ever costs 20; the shortest way takes 4 steps and earns 10."""
    world = tabulated("crossing5").world
    assert episode_range(world, (1.0, 0.0)) == (-20.0, 6.0)
    assert episode_range(world, (-1.0, 0.0)) == (-6.0, 20.0)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_range_holds_every_mean_and_is_reached_without_chance(tabulated, case):
    """The exact optimum lies within; in a world without chance it is the upper end."""
    table = table_of(tabulated, case)
    for weights in ((1.0, 0.0), (0.6, 0.8), (-0.8, 0.6)):
        low, high = episode_range(table.world, weights)
        reward = weights[0] * table.mdp.rewards.env + weights[1] * table.mdp.rewards.social
        best = horizon_optimum(table.mdp, reward, table.world.horizon).value
        worst = -horizon_optimum(table.mdp, -reward, table.world.horizon).value
        assert low <= worst + 1e-9 and best <= high + 1e-9
        if len(table.world.chance) == 1:
            assert (low, high) == (pytest.approx(worst), pytest.approx(best))


def test_impossible_chance_outcomes_do_not_count(tabulated):
    never, rarely = (
        episode_range(tabulated("crossing7", spawn_probability=p).world, (0.0, 1.0))
        for p in (0.0, 1e-9)
    )
    assert rarely[0] < never[0] and rarely[1] > never[1]
