"""Learners of the comparison by name."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from socialiq import Demonstrations, RewardPair, score, weights
from socialiq.evaluation import rollout
from socialiq.learners import acting, cql
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.collect import Collector
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import train
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.nn.q_network import network_of
from socialiq_lab import comparison_runs as runs_of_methods
from socialiq_lab.comparison_runs import Arena, Learner, Run, iq_learn, offline
from studies.compare_methods.baselines import clones
from studies.compare_methods.baselines import offline as values
from studies.compare_methods.baselines.online import LSIQ, TREX, Inferred, inferring
from studies.compare_methods.baselines.shared import totals_of


def _preset(name: str) -> tuple[dial.DialConfig, dial.DialHyperparameters]:
    """Return the settings of a dial that sees times as they are."""
    preset = dial.PRESETS[name]
    return dataclasses.replace(preset.structure, redraw_times=0), preset.numbers


BEST = 3  # one episode in so many is cloned by `clone_of_best`, those with the greatest R(α)


def best_episodes(data: Demonstrations, angle: float) -> Demonstrations:
    """Return the best part of the episodes by R(α) at an angle in degrees, ties included."""
    scores = score(weights(angle), RewardPair(*totals_of(data).T))
    above = len(scores) - np.searchsorted(np.sort(scores), scores, side="right")
    return data.select(np.flatnonzero(BEST * above < len(scores)))


def _clone_of_best(arena: Arena, runs: Sequence[Run]) -> list[Any]:
    """Clone the best episodes of each run's data set at its angle."""
    pairs = list(dict.fromkeys((run.angle, run.dataset) for run in runs))
    datasets = [best_episodes(arena.datasets[number], angle) for angle, number in pairs]
    of_best = [run._replace(dataset=pairs.index((run.angle, run.dataset))) for run in runs]
    return offline(bc.BehaviourCloning)(dataclasses.replace(arena, datasets=datasets), of_best)


def _multi_intention(arena: Arena, runs: Sequence[Run]) -> list[Any]:
    """Train the intentions; an update of all three counts as three."""
    share = dataclasses.replace(arena, updates=max(arena.updates // len(rollout.MODES), 1))
    return offline(values.MultiIntention)(share, runs)


PARIRL_SHARE = 7
"""One part in so many of ParIRL's updates infers the reward of either set of experts."""


def _pareto_irl(arena: Arena, runs: Sequence[Run]) -> list[Any]:
    """Infer the egoists' and the altruists' rewards, then train a dial of each run on both."""
    first = dataclasses.replace(arena, updates=max(arena.updates // PARIRL_SHARE, 1))
    inferring_runs, dialling_runs = [], []
    for run in runs:
        setting = dict(run.setting)
        temperature = (("temperature", setting.pop("irl_temperature")),)
        for mode in ("egoistic", "altruistic"):
            inferring_runs.append(run._replace(angle=rollout.MODES[mode], setting=temperature))
        dialling_runs.append(run._replace(setting=tuple(setting.items()), dataset=0))
    of_modes, placed = first.of_each_mode(inferring_runs)
    kinds = iq.IQLearnConfig, iq.IQLearnHyperparameters
    settings = [of_modes.settings(*kinds, run, prior="none") for run in placed]
    static, numbers = settings[0][0], [entry for _, entry in settings]
    options = first.callbacks(), arena.chunk
    trained = train_iq(static, numbers, of_modes.datasets, arena.world, *options)
    rewards = [
        Inferred(network_of(trained.networks, number), run.temperature, run.discount)
        for number, run in enumerate(numbers)
    ]
    second = dataclasses.replace(arena, updates=arena.updates - 2 * first.updates, world=None)
    preset = _preset("online-alone")
    dials = [
        runs_of_methods.dial_settings(second, *preset, run, ("discount",)) for run in dialling_runs
    ]
    shape = dataclasses.replace(dials[0][0], replay_batch=2 * arena.structure.batch_size)
    source = second.source(shape.updates, shape.environments)
    dial_numbers = [entry for _, entry in dials]
    collector = Collector(
        [inferring(source, pair) for pair in zip(rewards[::2], rewards[1::2], strict=True)],
        [entry.seed for entry in dial_numbers],
        acting.dials(shape, dial_numbers),
    )
    options = second.callbacks(), second.chunk, collector
    front = train.train(shape, dial_numbers, [], None, second.sizes, *options)
    return [front.policy(number) for number in range(len(runs))]


LEARNERS: Mapping[str, Learner] = {
    "clone": offline(bc.BehaviourCloning),
    "clone_by_return": offline(bc.BehaviourCloning, weighted=True),
    "clone_by_advantage": offline(bc.BehaviourCloning, weighted=True, weighted_by="advantage"),
    "clone_of_best": _clone_of_best,
    "dwbc": offline(clones.DiscriminatorWeighted),
    "iq_learn": iq_learn(prior="none"),
    "iq_learn_offline": iq_learn(acts=False, prior="none", online=False, value_term="value_expert"),
    "ls_iq": iq_learn(LSIQ, prior="none"),
    "multi_intention": _multi_intention,
    "trex": iq_learn(TREX, prior="none"),
    "sprinql": offline(values.SPRINQL),
    "cql": offline(cql.ConservativeQ),
    "iql": offline(values.ImplicitQLearning),
    "outcome_conditioned": offline(clones.OutcomeConditioned),
    "guidance": offline(clones.GuidedCloning),
    "pareto_irl": _pareto_irl,
    "rl": runs_of_methods.reinforcement,
    "thesis": iq_learn(prior="reward", target_kind=iq.GRID.target_kind),
    "dial_offline": runs_of_methods.dialled(*_preset("offline"), "discount"),
    "dial_online": runs_of_methods.dialled(*_preset("online-clockless"), "discount"),
}
"""By the `learner` of a method in STUDY.toml."""
