"""Update rates: ours, one program and many; and an eager PyTorch loop of the same sizes.

The peer is the loop that IQ-Learn implementations in PyTorch have: a module, autograd, Adam,
batches gathered from tensors, one update at a time, on one thread (more threads make so small a
network slower). It is spared the environment step that ours includes, so the ratio is a careful
one.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from socialiq.errors import UserError
from socialiq.evaluation.exact import Optimum
from socialiq.evaluation.rollout import trajectory_datasets
from socialiq.learners.iq_learn import config as presets
from socialiq.learners.iq_learn.config import IQLearnConfig, IQLearnHyperparameters
from socialiq.learners.iq_learn.train import train
from socialiq.mdp.solve import value_iteration
from socialiq.social.angle import score, weights
from socialiq.worlds.enumerate import Table, tabulate
from socialiq.worlds.registry import make_grid

UPDATES = 3000  # of one run, compilation not counted
SWEEP_UPDATES = 500
SWEEP_SEEDS = 5


def run(repeats: int) -> dict[str, Any]:
    """Measure each side in turn, `repeats` times.

    Returns:
        Medians by name: updates per second, ratios, seconds.

    Raises:
        UserError: If PyTorch is not installed.
    """
    table = tabulate(make_grid("crossing7"))
    data = trajectory_datasets(table, [0], 60)
    peer = torch_loop(data[0])
    static = dataclasses.replace(presets.GRID, updates=UPDATES)
    ours, theirs = [], []
    for _ in range(repeats):
        ours.append(UPDATES / training_seconds(static, [IQLearnHyperparameters()], data, table))
        theirs.append(UPDATES / timed(lambda: peer(UPDATES)))
    runs = [
        IQLearnHyperparameters(strength=strength, seed=seed)
        for strength in presets.SWEEP_STRENGTHS
        for seed in range(SWEEP_SEEDS)
    ]
    sweep = dataclasses.replace(presets.SWEEP, updates=SWEEP_UPDATES)
    together = [training_seconds(sweep, runs, data, table) for _ in range(repeats)]
    sample = runs[:: len(runs) // 8]  # each needs a program of its own: a few stand for all
    apart = [
        sum(training_seconds(sweep, [one], data, table) for one in sample)
        * (len(runs) / len(sample))
        for _ in range(repeats)
    ]
    return {
        "ours_updates_per_second": statistics.median(ours),
        "torch_updates_per_second": statistics.median(theirs),
        "ratio_to_torch": statistics.median(a / b for a, b in zip(ours, theirs, strict=True)),
        "sweep_lanes": len(runs),
        "sweep_together_seconds": statistics.median(together),
        "sweep_one_by_one_seconds": statistics.median(apart),
        "ratio_together": statistics.median(b / a for a, b in zip(together, apart, strict=True)),
        "solve_12096_states_seconds": statistics.median(
            timed(lambda: solve(table)) for _ in range(repeats)
        ),
        "attainable_set_seconds": statistics.median(
            timed(lambda: Optimum(table.reachable_part())) for _ in range(repeats)
        ),
        "repeats": repeats,
    }


def timed(work: Callable[[], Any]) -> float:
    """Wall-clock seconds of one call."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def solve(table: Table) -> None:
    """Value iteration on all states at 45 degrees."""
    value_iteration(table.mdp, score(weights(45.0), table.mdp.rewards), 0.99)


def training_seconds(
    static: IQLearnConfig,
    hyperparameters: list[IQLearnHyperparameters],
    data: list[Any],
    table: Table,
) -> float:
    """Seconds of a training run after its first, compiling chunk, scaled to all its updates."""
    from socialiq.learners.callbacks import Callbacks

    stamps: list[tuple[int, float]] = []
    callbacks = Callbacks(
        on_report=lambda report: stamps.append((report.done, time.perf_counter()))
    )
    chunk = static.updates // 5
    train(static, hyperparameters, data, table.world, callbacks, chunk)
    (first, began), (last, ended) = stamps[0], stamps[-1]
    return (ended - began) * static.updates / (last - first)


def torch_loop(data: Any) -> Callable[[int], None]:
    """The peer: returns a function that does so many updates."""
    try:
        import torch
    except ImportError as error:
        raise UserError(
            "this benchmark needs PyTorch: pip install 'socialiq-lab[bench]' in this environment"
        ) from error
    torch.set_num_threads(1)
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    returns = data.returns("running", 0.99)
    columns = {
        "observation": torch.tensor(data.observation),
        "action": torch.tensor(data.action).long(),
        "next": torch.tensor(data.next_observation),
        "done": torch.tensor((data.ending != 0).astype("float32")),
        "target": torch.tensor(returns.env.astype("float32")),
    }
    replay = {name: column.clone() for name, column in columns.items()}

    def network() -> Any:
        return torch.nn.Sequential(
            torch.nn.Linear(6, 64),
            torch.nn.ReLU(),
            torch.nn.Linear(64, 64),
            torch.nn.ReLU(),
            torch.nn.Linear(64, 3),
        )

    online, target_network = network(), network()
    target_network.load_state_dict(online.state_dict())
    adam = torch.optim.Adam(online.parameters(), lr=3e-4)

    def sample(source: dict[str, Any]) -> dict[str, Any]:
        rows = torch.from_numpy(rng.integers(len(data.action), size=64))
        return {name: column[rows] for name, column in source.items()}

    def update() -> None:
        expert, own = sample(columns), sample(replay)
        batch = {name: torch.cat([expert[name], own[name]]) for name in columns}
        q = online(batch["observation"])
        value = torch.logsumexp(q, dim=1)
        with torch.no_grad():
            follows = (1 - batch["done"]) * torch.logsumexp(target_network(batch["next"]), dim=1)
        reward = q.gather(1, batch["action"][:, None])[:, 0] - 0.99 * follows
        shown = reward[:64]
        loss = -shown.mean() + (value - 0.99 * follows).mean() + 0.5 * shown.square().mean()
        loss = loss + (shown - 2.0 * batch["target"][:64]).square().mean()
        adam.zero_grad()
        loss.backward()
        adam.step()
        with torch.no_grad():
            for old, new in zip(target_network.parameters(), online.parameters(), strict=True):
                old.mul_(0.995).add_(new, alpha=0.005)

    def many(count: int) -> None:
        for _ in range(count):
            update()

    return many
