"""The two worlds as the thesis draws them (Figs 5.1, 5.2), and an episode of each expert."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.evaluation.rollout import rollout_table
from socialiq.experiments.results import Results
from socialiq.worlds.enumerate import tabulate
from socialiq.worlds.pictures import filmstrip, picture
from socialiq.worlds.registry import make_grid
from socialiq.worlds.tabular_policy import expert_policy


def draw(results: Results) -> dict[str, Figure]:
    """Pictures of the first states, and one seeded episode of the prosocial experts."""
    figures = {}
    for number, name in enumerate(("crossing5", "crossing7"), start=1):
        table = tabulate(make_grid(name))
        figures[f"fig_5_{number}"] = picture(table.world, table.world.start[0][0])
        policy = expert_policy(table, MODES["prosocial"])
        steps = rollout_table(table, policy, 1, results.config["seeds"][0]).transitions
        states = np.vstack([steps.observation, steps.next_observation[-1:]]).astype(int)
        figures[f"{name}_prosocial_episode"] = filmstrip(table.world, states.tolist())
    return figures
