"""Methods of `morl-baselines`, as they are, on the tasks of `socialiq reproduce mo-gymnasium`.

    python -m venv peers && peers/bin/pip install -r benchmarks/peers/mo_gymnasium.txt
    peers/bin/python benchmarks/peers/mo_gymnasium_peer.py deep-sea-treasure Envelope

Each (task, method, seed) becomes one JSON file: mean totals of the policy at every angle, and the
settings. A file that exists is not made again.
"""

# The library is in the environment of mo_gymnasium.txt alone.
# pyright: reportMissingImports=false

from __future__ import annotations

import argparse
import importlib.metadata
import json
import math
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from mo_gymnasium.utils import make
from morl_baselines.common.evaluation import seed_everything
from morl_baselines.multi_policy.capql.capql import CAPQL
from morl_baselines.multi_policy.envelope.envelope import Envelope
from morl_baselines.multi_policy.gpi_pd.gpi_pd import GPILS
from morl_baselines.multi_policy.gpi_pd.gpi_pd_continuous_action import GPILSContinuousAction
from morl_baselines.multi_policy.multi_policy_moqlearning.mp_mo_q_learning import MPMOQLearning
from morl_baselines.multi_policy.pareto_q_learning.pql import PQL

ROOT = Path(__file__).parents[2]
TASKS = tomllib.loads((ROOT / "studies/mo_gymnasium/tasks.toml").read_text())
ANGLES = [float(angle) for angle in range(0, 91, 5)]
ITERATIONS = 5
"""Weights that GPI-LS learns one after the other."""

Task = dict[str, Any]
Act = Callable[[Any, np.ndarray], Any]
"""From an observation and weights that sum to 1 to an action."""


class Counted(gymnasium.Wrapper):
    """Environment that counts its steps, and whose first reset is seeded."""

    def __init__(self, env: gymnasium.Env, seed: int) -> None:
        super().__init__(env)
        self.steps, self._seed = 0, seed
        env.action_space.seed(seed)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        """Start an episode."""
        first, self._seed = self._seed, None
        return self.env.reset(seed=first if seed is None else seed, options=options)

    def step(self, action: Any) -> Any:
        """Take one step."""
        self.steps += 1
        return self.env.step(action)


def networks(task: Task) -> dict[str, Any]:
    """Return the settings that all methods with networks share; others are the library's own."""
    shared = {"net_arch": task["hidden"], "batch_size": task["batch_size"]}
    return shared | {"gamma": task["discount"]}


def exploring(steps: int) -> dict[str, Any]:
    """Return a share of random actions that falls from 1 to 0.2 in the first half of the steps."""
    return {"initial_epsilon": 1.0, "final_epsilon": 0.2, "epsilon_decay_steps": steps // 2}


def iterated(task: Task, held: gymnasium.Env) -> dict[str, Any]:
    """Return the arguments of `train` of the methods that learn weight by weight."""
    return {
        "total_timesteps": task["steps"],
        "eval_env": held,
        "ref_point": np.array(task["reference"]),
        "num_eval_episodes_for_front": 1,
    }


def envelope(task: Task, env: Any, held: Any, seed: int) -> tuple[Act, dict[str, Any]]:
    """Train Envelope Q-learning (Yang et al. 2019)."""
    del held
    settings = networks(task) | exploring(task["steps"])
    agent = Envelope(env, **settings, seed=seed, log=False, device="cpu")
    agent.train(total_timesteps=task["steps"])
    return agent.eval, settings


def gpi_ls(task: Task, env: Any, held: Any, seed: int) -> tuple[Act, dict[str, Any]]:
    """Train GPI-LS (Alegre et al. 2023), with one gradient step for each step instead of 20."""
    each = task["steps"] // ITERATIONS
    settings = networks(task) | {"gradient_updates": 1}
    made: type[Any] = GPILSContinuousAction
    if isinstance(env.action_space, gymnasium.spaces.Discrete):
        settings |= exploring(task["steps"])
        made = GPILS
    agent = made(env, **settings, seed=seed, log=False, device="cpu")
    agent.train(**iterated(task, held), timesteps_per_iter=each, checkpoints=False)
    return agent.eval, settings | {"timesteps_per_iter": each}


def gpi_tables(task: Task, env: Any, held: Any, seed: int) -> tuple[Act, dict[str, Any]]:
    """Train tables for weights that GPI-LS selects."""
    each = task["steps"] // ITERATIONS
    settings = {"learning_rate": 0.3, "gamma": task["discount"], "use_gpi_policy": True}
    settings |= exploring(each) | {"weight_selection_algo": "gpi-ls"}
    agent = MPMOQLearning(env, **settings, seed=seed, log=False)
    agent.train(**iterated(task, held), timesteps_per_iteration=each)
    return agent.eval, settings | {"timesteps_per_iteration": each}


def capql(task: Task, env: Any, held: Any, seed: int) -> tuple[Act, dict[str, Any]]:
    """Train CAPQL (Lu et al. 2023)."""
    settings = networks(task)
    agent = CAPQL(env, **settings, seed=seed, log=False, device="cpu")
    agent.train(task["steps"], held, np.array(task["reference"]))
    return agent.eval, settings


METHODS: dict[str, Callable[..., Any]] = {
    "Envelope": envelope,
    "GPI-LS": gpi_ls,
    "GPI-LS, tables": gpi_tables,
    "CAPQL": capql,
}
PARETO = "Pareto Q-learning"
"""It has no weights: it learns the set of all non-dominated totals (Van Moffaert and Nowé 2014)."""


def weights(angle: float) -> np.ndarray:
    """Return (cos, sin) of an angle in degrees, divided by their sum as the library wants."""
    pair = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    pair[np.abs(pair) < 1e-12] = 0.0
    return pair / pair.sum()


def totals(task: Task, env: gymnasium.Env, act: Act, weight: np.ndarray) -> list[float]:
    """Return the mean totals of both rewards over the evaluation's episodes."""
    summed = np.zeros(2)
    for episode in range(task["episodes"]):
        seen, _ = env.reset(seed=task["first_episode"] + episode)
        ended = False
        while not ended:
            seen, reward, terminated, truncated, _ = env.step(act(seen, weight))
            summed += np.asarray(reward)
            ended = terminated or truncated
    return (summed / task["episodes"]).tolist()


def pareto(task: Task, env: Any, held: Any, seed: int) -> tuple[list[list[float]], dict[str, Any]]:
    """Train Pareto Q-learning; return the totals of every policy of its set."""
    settings = {"gamma": 1.0, "initial_epsilon": 1.0, "final_epsilon": 0.2}
    settings |= {"epsilon_decay_steps": task["steps"] // 2}
    reference = np.array(task["reference"])
    agent = PQL(env, reference, **settings, seed=seed, log=False)
    found = agent.train(task["steps"], held, reference)
    return [agent.track_policy(np.array(one), held).tolist() for one in sorted(found)], settings


def piece(name: str, method: str, seed: int) -> dict[str, Any]:
    """Train and evaluate; return the content of one file."""
    task = TASKS[name]
    seed_everything(seed)
    env, held = (Counted(make(task["env"], **task.get("options", {})), seed) for _ in range(2))
    began = time.perf_counter()
    turned = method != PARETO
    train: Callable[..., Any] = METHODS[method] if turned else pareto
    found, settings = train(task, env, held, seed)
    seconds, checks = time.perf_counter() - began, held.steps
    shown = [totals(task, held, found, weights(one)) for one in ANGLES] if turned else found
    libraries = ("morl-baselines", "mo-gymnasium", "gymnasium", "torch", "numpy")
    return {
        "task": name,
        "method": method,
        "seed": seed,
        "steps": env.steps,
        "evaluation_steps_while_training": checks,
        "angles": ANGLES if turned else None,
        "totals": [[round(one, 6) for one in pair] for pair in shown],
        "settings": settings,
        "seconds": round(seconds, 1),
        "versions": {one: importlib.metadata.version(one) for one in libraries},
    }


def main() -> None:
    """Make the files that do not exist yet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", choices=list(TASKS))
    parser.add_argument("method", choices=[*METHODS, PARETO])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(300, 305)))
    parser.add_argument("--steps", type=int, help="instead of the task's, to try")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "mo-gymnasium" / "pieces")
    given = parser.parse_args()
    torch.set_num_threads(1)
    if given.steps:
        TASKS[given.task]["steps"] = given.steps
    given.out.mkdir(parents=True, exist_ok=True)
    for seed in given.seeds:
        short = "".join(one if one.isalnum() else "_" for one in given.method)
        file = given.out / f"{given.task}-{short}-{seed}.json"
        if not file.exists():
            made = piece(given.task, given.method, seed)
            file.write_text(json.dumps(made) + "\n")
            print(file.name, made["seconds"], "s")


if __name__ == "__main__":
    main()
