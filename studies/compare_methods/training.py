"""Learners of the comparison: from settings and demonstrations to policies by angle."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from socialiq.evaluation.rollout import MODES
from socialiq.learners import acting, cql
from socialiq.learners import behaviour_cloning as bc
from socialiq.learners.collect import Collector
from socialiq.learners.dial import config as dial
from socialiq.learners.dial import offline as regularised
from socialiq.learners.dial.train import train as train_dial
from socialiq.learners.iq_learn import config as iq
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.train import train as train_iq
from socialiq.nn.q_network import network_of
from socialiq_lab.comparison_runs import (
    Arena,
    Learner,
    Method,
    Run,
    in_programs,
    iq_learn,
    offline,
    reinforcement,
)
from studies.compare_methods.baselines import multi_intention_irl
from studies.compare_methods.baselines.conditioned import GuidedCloning, OutcomeConditioned
from studies.compare_methods.baselines.discriminator_weighted_bc import DiscriminatorWeighted
from studies.compare_methods.baselines.offline import SPRINQL, ImplicitQLearning
from studies.compare_methods.baselines.online import LSIQ, TREX, InferredReward, Rewards, inferring


def _multi_intention(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[Any]:
    """Train the intentions; an update of all three counts as three."""
    share = dataclasses.replace(arena, updates=max(arena.updates // len(MODES), 1))
    return in_programs(
        [
            share.settings(
                multi_intention_irl.IntentionConfig,
                multi_intention_irl.IntentionHyperparameters,
                run,
            )
            for run in runs
        ],
        lambda static, numbers: multi_intention_irl.train(
            static, numbers, arena.datasets, arena.callbacks(), arena.chunk
        ),
    )


def dial_settings(arena: Arena, preset: dial.DialPreset, run: Run) -> tuple[Any, Any]:
    """Return a dial's settings: its preset's, with the comparison's network, batches and budget."""
    base = arena.structure
    static = dataclasses.replace(
        preset.structure,
        **{name: getattr(base, name) for name in ("hidden", "activation", "view", "endings")},
        expert_batch=base.batch_size,
        replay_batch=base.batch_size,
        environments=base.env_steps_per_update,
        replay_capacity=base.replay_capacity,
        updates=arena.updates,
        redraw_times=0,
    )
    numbers = {"discount": arena.numbers.discount, "seed": run.seed, "dataset": run.dataset}
    return static, dataclasses.replace(preset.numbers, **numbers | dict(run.setting))


def dial_collector(
    arena: Arena, static: dial.DialConfig, numbers: Sequence[dial.DialHyperparameters]
) -> Collector | None:
    """Return what lets dials act outside JAX; None if the world is in JAX."""
    if arena.world is not None:
        return None
    source = arena.source(static.updates, static.environments)
    behaviour = acting.dials(static, numbers)
    seeds = [run.seed for run in numbers]
    return Collector([source] * len(numbers), seeds, behaviour, static.driven_share > 0)


def dialled(preset: str) -> Learner:
    """Return the training of a dial.

    Args:
        preset: Name in `learners.dial.config.PRESETS`.
    """

    def train(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[Any]:
        return in_programs(
            [dial_settings(arena, dial.PRESETS[preset], run) for run in runs],
            lambda static, numbers: train_dial(
                static,
                numbers,
                arena.datasets,
                arena.world if static.online else None,
                callbacks=arena.callbacks(),
                chunk=arena.chunk,
                before_chunk=dial_collector(arena, static, numbers) if static.online else None,
            ),
        )

    return train


def _regularised(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[Any]:
    """Train the behaviour-regularised dial, whose stages share the updates."""
    preset, numbers = dial.OfflineDialConfig(), dial.OfflineDialHyperparameters()
    names = ("hidden", "activation", "view", "batch_size")
    share = arena.updates // (2 + preset.critic_factor)  # behaviour and dial: one each
    static = dataclasses.replace(
        preset,
        **{name: getattr(arena.structure, name) for name in names},
        updates=max(share, 1),
    )
    stages = regularised.train(
        static,
        [dataclasses.replace(numbers, seed=run.seed, **dict(run.setting)) for run in runs],
        [arena.datasets[entry.dataset] for entry in runs],
        lambda _stage: arena.callbacks(),
        arena.chunk,
    )
    return [stages["dial"].policy(number) for number in range(len(runs))]


PARIRL_SHARE = 7
"""One part in so many of ParIRL's updates infers the reward of either set of experts."""


def _pareto_irl(arena: Arena, _method: Method, runs: Sequence[Run]) -> list[Any]:
    """Infer the egoists' and the altruists' rewards, then train a dial of each run on both."""
    first = dataclasses.replace(arena, updates=max(arena.updates // PARIRL_SHARE, 1))
    second = dataclasses.replace(arena, updates=arena.updates - 2 * first.updates, world=None)
    ends = (MODES["egoistic"], MODES["altruistic"])
    datasets, placed = arena.of_each_mode(
        [
            run._replace(
                angle=end, setting=(("temperature", dict(run.setting)["irl_temperature"]),)
            )
            for run in runs
            for end in ends
        ]
    )
    kinds = iq.IQLearnConfig, iq.IQLearnHyperparameters
    settings = [first.settings(*kinds, run, prior="none") for run in placed]
    static, numbers = settings[0][0], [entry for _, entry in settings]
    options = first.callbacks(), arena.chunk, first.collector(static, numbers)
    trained = train_iq(static, numbers, datasets, arena.world, *options)
    inferred = [
        InferredReward(
            network_of(trained.networks, number), run_numbers.temperature, run_numbers.discount
        )
        for number, run_numbers in enumerate(numbers)
    ]
    dialling = []
    for run in runs:
        setting = tuple(pair for pair in run.setting if pair[0] != "irl_temperature")
        dialling.append(run._replace(setting=setting, dataset=0))
    return _fronts(second, dialling, list(zip(inferred[::2], inferred[1::2], strict=True)))


def _fronts(arena: Arena, runs: Sequence[Run], rewards: Sequence[Rewards]) -> list[Any]:
    """Train a dial for each pair of inferred rewards; they act outside JAX, in one program."""
    settings = [dial_settings(arena, dial.PRESETS["online-alone"], run) for run in runs]
    static = dataclasses.replace(settings[0][0], replay_batch=2 * arena.structure.batch_size)
    numbers = [run_numbers for _, run_numbers in settings]
    source = arena.source(static.updates, static.environments)
    collector = Collector(
        [inferring(source, pair) for pair in rewards],
        [entry.seed for entry in numbers],
        acting.dials(static, numbers),
    )
    callbacks = arena.callbacks()
    trained = train_dial(static, numbers, [], None, arena.sizes, callbacks, arena.chunk, collector)
    return [trained.policy(number) for number in range(len(runs))]


LEARNERS: Mapping[str, Learner] = {
    "clone": offline(bc.BehaviourCloning),
    "clone_by_return": offline(bc.BehaviourCloning, weighted=True),
    "clone_by_advantage": offline(bc.BehaviourCloning, weighted=True, weighted_by="advantage"),
    "dwbc": offline(DiscriminatorWeighted),
    "iq_learn": iq_learn(prior="none"),
    "iq_learn_offline": iq_learn(acts=False, prior="none", online=False, value_term="value_expert"),
    "ls_iq": iq_learn(LSIQ, prior="none"),
    "multi_intention": _multi_intention,
    "trex": iq_learn(TREX, prior="none"),
    "sprinql": offline(SPRINQL),
    "cql": offline(cql.ConservativeQ),
    "iql": offline(ImplicitQLearning),
    "outcome_conditioned": offline(OutcomeConditioned),
    "guidance": offline(GuidedCloning, advantage="advantage"),
    "pareto_irl": _pareto_irl,
    "rl": reinforcement,
    "thesis": iq_learn(prior="reward", target_kind=presets.GRID.target_kind),
    "dial_offline": dialled("offline"),
    "dial_regularised": _regularised,
    "dial_online": dialled("online-clockless"),
}
"""By the name in `Method.learner`; those of other libraries are in `peers`."""
