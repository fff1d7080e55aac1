"""The influence zone from branches alone, compared with the zone of Eq 4.2 (thesis 8.2).

A vehicle is moved if what it drives in the next decisions hinges on which action the ego repeats. A
tree and a boosted ensemble learn from one half of the episodes which vehicles are moved; they are
judged on the second half. One code does so for every road, and for a gridworld's states.
"""

import functools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Num
from scipy.stats import rankdata

from socialiq import UserError, tabulate
from socialiq.evaluation.simulate import actor_of
from socialiq.foreign import optional
from socialiq.nn.dial_policy import DialPolicy
from socialiq.storage import packaged_results
from socialiq.types import Policy, Row
from socialiq.worlds.highway.effects import CAUSED
from socialiq.worlds.highway.options import SOCIAL_SIGNALS, RoadOptions
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.registry import make_grid, open_world
from socialiq_lab.jobs import Job, Part, StageCallback, keeps_rows
from studies.influence_zone import moved

DIALS = {
    "Eq 4.2": "intersection-dial-clock/iterated.safetensors",
    "effects": "caused-effects/dial.safetensors",
}
"""Committed dials whose decisions are compared."""
GRID = "crossing7"
MEASURES = "Eq 4.2", "encounter", "FeAR", "courtesy"
DEPTH = 4  # of the small tree
LEAVES = 4  # of a tree, that a table has
CELL = 10  # m, side of a cell of the map
SIDE = 40  # m, to which the map goes on each side


def jobs(config: Any) -> list[Job]:
    """Return a job for each road, one for the gridworld, and one for each dial and angle.

    Raises:
        UserError: If scikit-learn is missing, a road or an angle is none, or there are fewer than
            two episodes.
    """
    _scikit_learn()
    if config.episodes < 2:
        raise UserError(
            f"episodes must be at least 2, half of them to learn from, got {config.episodes}"
        )
    for road in config.roads:
        road_with_effects(road)
    dials = [
        Job(f"dials/{name}, {angle:g}", dial_rows, Part(config, (name, angle)))
        for name in DIALS
        for angle in config.angles
        if _dial(name, angle)
    ]
    zones = [Job(f"zones/{road}", road_rows, Part(config, road)) for road in config.roads]
    return [*zones, Job(f"zones/{GRID}", grid_rows, Part(config)), *dials]


def _dial(name: str, angle: float) -> Policy:
    return DialPolicy.load(packaged_results() / DIALS[name]).at(angle)


@keeps_rows
def road_rows(part: Part, _folder: Path, _on_stage: StageCallback) -> dict[str, list[Row]]:
    """Learn and judge the zone of a road."""
    first = part.study.first_seed
    at_random = functools.partial(moved.RandomActor, seed=first)
    seeds = first + np.arange(part.study.episodes)
    driven = list(moved.decisions(road_with_effects(part.of), at_random, seeds))
    features, hand, metres, episode = (
        np.concatenate([getattr(decision, name) for decision in driven])
        for name in ("features", "in_hand_zone", "metres", "episode")
    )
    spread = metres.max(axis=1) - metres.min(axis=1)
    row, tree = learned_zone(features, spread, hand, episode % 2 == 0, moved.MOVED)
    label: Row = {"world": part.of}
    return {
        "zones": [label | row],
        "trees": [label | leaf for leaf in leaf_rows(tree, moved.ROAD_FEATURES)],
        "map": [label | cell for cell in map_rows(features, spread > moved.MOVED)],
    }


@keeps_rows
def grid_rows(part: Part, _folder: Path, _on_stage: StageCallback) -> dict[str, list[Row]]:
    """Learn and judge the zone of the gridworld."""
    features, is_moved = moved.grid_vehicles(tabulate(make_grid(GRID)))
    learning = np.random.default_rng(part.study.first_seed).random(len(features)) < 0.5
    hand = (features[:, 0] == 2) & (features[:, 2] < 3)  # thesis 5.1.2: before the conflict cell
    row, tree = learned_zone(features, is_moved * 1.0, hand, learning, 0.5)
    label: Row = {"world": GRID}
    trees = [label | leaf for leaf in leaf_rows(tree, moved.GRID_FEATURES)]
    return {"zones": [label | row], "trees": trees}


@keeps_rows
def dial_rows(part: Part, _folder: Path, _on_stage: StageCallback) -> dict[str, list[Row]]:
    """Correlate measures of a dial's decisions with what others lose."""
    name, angle = part.of
    label: Row = {"dial": name, "angle": angle}
    seeds = part.study.first_seed + np.arange(part.study.episodes)
    rows = [label | row for row in correlation_rows(_dial(name, angle), seeds)]
    return {"correlations": rows}


def _scikit_learn() -> list[Any]:
    """Return scikit-learn's modules of ensembles, trees and metrics."""
    return [
        optional(f"sklearn.{name}", "boosting", "the learned zone", "socialiq-lab")
        for name in ("ensemble", "tree", "metrics")
    ]


def road_with_effects(name: str) -> RoadWorld:
    """Return a road whose r_social is what the ego causes."""
    world = open_world(f"{name}{CAUSED}")
    assert isinstance(world, RoadWorld)
    return world


def learned_zone(
    features: Num[np.ndarray, "vehicle feature"],
    spread: Float[np.ndarray, " vehicle"],
    hand: Bool[np.ndarray, " vehicle"],
    train: Bool[np.ndarray, " vehicle"],
    least: float,
) -> tuple[Row, Any]:
    """Learn which vehicles are moved by at least a distance; judge the learned zone.

    The learned zone has as many of the vehicles that were held out as the zone by hand.

    Args:
        features: Features of each vehicle, (vehicle, feature).
        spread: Metres that hinge on the choice.
        hand: Whether the zone of the thesis has the vehicle.
        train: Whether the vehicle is learned from; all further ones are held out.
        least: Metres from which a vehicle is moved.

    Returns:
        Shares, areas under the curve, recalls and precisions, and the fitted tree.
    """
    ensemble, trees, metrics = _scikit_learn()
    is_moved = spread > least
    test = ~train
    boosted = ensemble.HistGradientBoostingClassifier(max_iter=80, random_state=0)
    tree = trees.DecisionTreeClassifier(max_depth=DEPTH, random_state=0)
    chances = [
        model.fit(features[train], is_moved[train]).predict_proba(features[test])[:, -1]
        for model in (boosted, tree)
    ]
    row: Row = {"vehicles": len(spread), "moved": float(is_moved.mean())}
    row["hand"] = float(hand.mean())
    for name, chance in zip(("boosted", "tree"), chances, strict=True):
        row[f"auc_{name}"] = float(metrics.roc_auc_score(is_moved[test], chance))
    size = int(hand[test].sum())
    learned = np.zeros(len(hand[test]), bool)
    learned[np.argsort(-chances[0], kind="stable")[:size]] = True
    zones = {"hand": hand[test], "learned": learned, "tree": chances[1] > 0.5}
    for name, zone in zones.items():
        hits = float((zone & is_moved[test]).sum())
        row[f"recall_{name}"] = hits / max(int(is_moved[test].sum()), 1)
        row[f"precision_{name}"] = hits / max(int(zone.sum()), 1)
        row[f"metres_{name}"] = float(spread[test][zone].sum() / max(spread[test].sum(), 1e-12))
    return row, tree


def leaf_rows(tree: Any, names: Sequence[str]) -> list[Row]:
    """Return the leaves of a tree with the most moved vehicles: rule, shares of all vehicles.

    Args:
        tree: Fitted classification tree of scikit-learn.
        names: Names of the features.

    Returns:
        At most `LEAVES` rows with `moved`, `share` and `rule`, those of the most moved vehicles
        first.
    """
    nodes = tree.tree_
    leaves = []
    low = nodes.children_left.tolist()
    high = nodes.children_right.tolist()
    share = nodes.n_node_samples / nodes.n_node_samples[0]
    moved_share = nodes.value[:, 0, -1]

    def follow(node: int, rule: list[str]) -> None:
        if low[node] < 0:
            row = {"moved": float(moved_share[node]), "share": float(share[node])}
            leaves.append(row | {"rule": " and ".join(rule)})
            return
        name = names[nodes.feature[node]]
        limit = nodes.threshold[node]
        follow(low[node], [*rule, f"{name} <= {limit:.3g}"])
        follow(high[node], [*rule, f"{name} > {limit:.3g}"])

    follow(0, [])
    return sorted(leaves, key=lambda leaf: -leaf["moved"] * leaf["share"])[:LEAVES]


def map_rows(features: np.ndarray, is_moved: np.ndarray) -> Iterator[Row]:
    """Yield the share of vehicles that are moved, by their place as seen from the ego.

    Args:
        features: Features of each vehicle, of which the first two are metres ahead and to the left.
        is_moved: Whether each vehicle is moved.

    Yields:
        A row for each cell of `CELL` metres with 20 vehicles or more.
    """
    ahead, left = (CELL * np.round(features[:, number] / CELL) for number in range(2))
    centres = np.arange(-SIDE, SIDE + 1, CELL)
    for x in centres:
        for y in centres:
            there = (ahead == x) & (left == y)
            if there.sum() >= 20:
                share = float(is_moved[there].mean())
                place = {"ahead": int(x), "left": int(y)}
                yield place | {"vehicles": int(there.sum()), "moved": share}


def correlation_rows(policy: Policy, seeds: np.ndarray) -> Iterator[Row]:
    """Yield the correlation of measures of decisions with the metres that others lose.

    The world is the intersection. By decision the loss is that of the look ahead against the drive
    without the ego. By episode the sum of the measure is compared with the delay to the common end.

    Args:
        policy: Policy that drives.
        seeds: Seed of each episode.

    Yields:
        A row for each of `MEASURES`.
    """
    decisions: dict[str, list[np.ndarray]] = {name: [] for name in (*MEASURES, "lost")}
    sums = {name: np.zeros(len(seeds)) for name in (*MEASURES, "delay")}
    world = road_with_effects("intersection")
    for decision in moved.decisions(world, lambda batch: actor_of(batch, policy), seeds):
        values = costs_of(decision, world.options)
        rows = np.unique(decision.episode)
        for name, column in decisions.items():
            column.append(values[name][rows])
        for name, total in sums.items():
            total += np.where(decision.running, values[name], 0.0)
    columns = {name: np.concatenate(column) for name, column in decisions.items()}
    for name in MEASURES:
        ranks = rankdata(columns[name]), rankdata(columns["lost"])
        yield {
            "measure": name,
            "by_decision": float(np.corrcoef(columns[name], columns["lost"])[0, 1]),
            "ranks": float(np.corrcoef(*ranks)[0, 1]),
            "by_episode": float(np.corrcoef(sums[name], sums["delay"])[0, 1]),
        }


def costs_of(decision: moved.Decision, options: RoadOptions) -> dict[str, np.ndarray]:
    """Return a decision's costs to others by each measure, "lost" and "delay".

    The cost by Eq 4.2 is that of the decision itself. Courtesy (Sun, Zhan, Tomizuka and Dragan
    2018, arXiv:1808.02633) is what others would drive more if the ego repeated its most helpful
    action. FeAR is summed over the vehicles.

    Args:
        decision: Vehicles around the egos before a decision, and its signals.
        options: Options of the road, whose weights make the cost by Eq 4.2.

    Returns:
        By name an array with one entry for each row of the batch.
    """
    by_vehicle = {
        "FeAR": decision.lost_actions,
        "courtesy": decision.metres.max(axis=1) - decision.chosen,
        "lost": decision.absent - decision.chosen,
    }
    costs: dict[str, np.ndarray] = {
        name: np.bincount(decision.episode, values, len(decision.running))
        for name, values in by_vehicle.items()
    }
    social = [
        getattr(options, f"{name}_weight") * decision.signals[name] for name in SOCIAL_SIGNALS
    ]
    costs["Eq 4.2"] = -np.sum(social, axis=0)
    return costs | {name: decision.signals[name] for name in ("encounter", "delay")}
