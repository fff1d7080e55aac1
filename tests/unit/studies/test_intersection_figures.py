"""The intersection study's figures come from its tables, here of made-up rows."""

import zlib
from itertools import product

import numpy as np
from matplotlib.figure import Figure
from studies.intersection import figures as intersection
from studies.intersection import study
from studies.intersection.figures import draw, fig_6_5
from studies.intersection.figures_ablations import ABLATIONS
from studies.intersection.plan import (
    ENDINGS,
    SHIPPED,
    SIZES,
    STRENGTHS,
    TARGETS,
    TEMPERATURES,
    TRAINED,
    VIEWS,
    Config,
    learner_name,
)
from studies.intersection.study import best_angles

from socialiq.evaluation.expert_demonstrations import MODES
from socialiq.plotting.style import png
from socialiq.social.angle import angle_of
from socialiq.social.returns import TARGET_KINDS
from socialiq.worlds.intersection.policies import NAMES
from socialiq_lab import results as store
from socialiq_lab.intersection import thesis_values
from socialiq_lab.intersection.experts import expert_name

MAIN = {
    "fig_6_5_ring",
    "table_6_2",
    "presets",
    "tradeoff",
    "fig_a_1",
    "learning",
    "exposure",
}
SMALL = {"seeds": (10, 11), "expert_seed": 20, "ablation_seeds": (30, 31)}
ENDS = {  # arrival, collision, r_env, r_social
    "egoistic": (0.85, 0.12, 6.8, -0.6),
    "prosocial": (0.7, 0.05, 5.5, 1.1),
    "altruistic": (0.02, 0.04, -1.5, 1.7),
    "baseline": (0.4, 0.15, 3.5, 0.5),
    "go": (0.6, 0.4, 6.66, -2.28),
    "idle": (0.6, 0.4, 6.66, -2.28),
    "wait": (0.0, 0.0, -2.4, 0.3),
    "stop_line": (0.0, 0.23, 1.1, 1.0),
    "random": (0.4, 0.38, 5.2, -1.8),
    "gap_3s": (0.7, 0.05, 6.5, 0.85),
    "gap_4s": (0.6, 0.01, 5.9, 1.1),
}


def policy(name, readout):
    """A made-up row of a policy, near what its name promises."""
    parts = name.split("/")
    kind = next((one for one in ENDS if one in parts), "egoistic")
    kind = "wait" if "thesis" in parts or "running" in parts else kind
    rng = np.random.default_rng(zlib.crc32(f"{name}{readout}".encode()))
    noise = rng.normal(size=6) * (0.0 if kind in ("go", "idle") else 1.0)
    arrival, collision, env, social = ENDS[kind]
    collision = float(np.clip(collision + 0.02 * noise[0], 0, 1))
    arrival = float(np.clip(arrival + 0.05 * noise[1], 0, 1 - collision))
    row = {"policy": name, "readout": readout, "episodes": 2000, "collision": collision}
    row |= {"arrival": arrival, "timeout": 1 - arrival - collision}
    row |= {"speed_kmh": 8 + 22 * arrival + noise[2], "stopped": 0.6 * (1 - arrival)}
    row |= {"r_env": env + 0.3 * noise[3], "r_social": social + 0.2 * noise[4]}
    row["angle"] = angle_of(row["r_env"], row["r_social"])
    row["at_fault_per_conflict"] = 0.1 * collision
    enters = kind != "altruistic" or noise[5] > 0
    for place, factor in (("", 1.0), ("_low", 0.9), ("_high", 1.1)):
        row[f"at_fault_per_episode{place}"] = 0.7 * factor * collision
        # A rate over nothing is an empty cell.
        row[f"at_fault_per_entry{place}"] = 0.9 * factor * collision if enters else ""
    return row


def table_6_2():
    """Ours near the thesis' own."""
    rows = []
    for metric, columns in thesis_values.TABLE_6_2.items():
        for number, (name, (mean, spread)) in enumerate(columns.items()):
            expert = name.startswith("expert")
            head = ("experts", "flat") if expert else SHIPPED
            rows.append(
                dict(zip(("preset", "setting"), head, strict=True))
                | {"readout": "greedy", "policy": name, "metric": metric}
                | {"thesis": mean, "thesis_spread": spread, "ours": 0.9 * mean + number}
                | {"over_training": "" if expert else 4.0, "over_evaluation": 2.0}
                | {"low": mean - 3, "high": mean + 6}
            )
    return rows


def curve(name):
    """A made-up curve, rising to the policy's value."""
    top = policy(name, "greedy")["r_env"]
    times = np.arange(1, 11)
    values = top - 3 * np.exp(-times / 3)
    return [
        {"run": name, "updates": 1000 * t, "total": v} for t, v in zip(times, values, strict=True)
    ]


def distributions():
    """Forty bins of each mode and signal."""
    edges = np.linspace(-5, 1, 41)
    rows = []
    for signal in ("r_self", "r_global", "r_env", "r_social"):
        for number, mode in enumerate(MODES):
            shares = np.random.default_rng(number).dirichlet(5 * 0.7 ** abs(np.arange(-28, 12)))
            rows += [
                {"mode": mode, "signal": signal, "from": low, "to": high, "share": share}
                for low, high, share in zip(edges[:-1], edges[1:], shares, strict=True)
            ]
    return rows


def joined(*parts):
    return "/".join(map(str, parts))


def names(config):
    """The policies of each part, as the plan calls them."""
    seeds, first = config.ablation_seeds, config.expert_seed
    cells = product(TARGET_KINDS, TEMPERATURES, ENDINGS, TARGETS, seeds[:1])
    amounts = [(mixture, size) for mixture, sizes in SIZES.items() for size in sizes]
    return {
        "main": [expert_name("flat", mode, first) for mode in MODES]
        + [
            learner_name(*group, target, seed)
            for group in TRAINED
            for target in TARGETS
            for seed in config.seeds
        ]
        + [f"drivers/{name}" for name in NAMES],
        "timeouts": [f"timeouts/through/{mode}/{first}" for mode in ("prosocial", "altruistic")],
        "views": [f"views/{view}/{seed}" for view, seed in product(VIEWS, seeds)],
        "strengths": [joined("strengths", *one) for one in product(STRENGTHS, MODES, seeds)],
        "targets": [
            joined("targets", *one)
            for one in cells
            if (one[0], one[3]) == ("running", "baseline") or one[3] in MODES
        ],
        "data": [
            f"data/{mixture}/{size}/{target}/{seed}"
            for (mixture, size), target, seed in product(amounts, TARGETS, seeds)
        ],
    }


def made_up(config):
    """Results of every policy of the chosen parts."""
    parts = names(config)
    chosen = [name for part in config.parts for name in parts[part]]
    rows = [policy(name, readout) for name in chosen for readout in ("greedy", "soft")]
    main = [row for row in rows if row["policy"] in parts["main"] and row["readout"] == "greedy"]
    trained = [name for name in parts["main"] if not name.startswith("drivers/")]
    tables = {
        "policies": rows,
        "table_6_2": table_6_2(),
        "fig_a_1": distributions(),
        "best_angles": best_angles(main),
        "curves": [row for name in trained for row in curve(name)],
    }
    summary = study._summary(config, tables | {"table_a_1": [], "table_a_2": []})
    return store.Results.of("intersection", config, tables, summary)


def test_every_figure_is_drawn_from_the_csv_alone(tmp_path):
    store.save(made_up(Config(**SMALL)), tmp_path / "results", {}, replace=False)
    drawn = draw(store.load(tmp_path / "results"))
    assert set(drawn) == MAIN | set(ABLATIONS)
    assert all(picture.startswith(b"\x89PNG") for picture in png(drawn).values())


def test_a_part_that_was_not_run_is_left_out():
    config = Config(seeds=(10,), expert_seed=20, ablation_seeds=(30,), parts=("main", "views"))
    assert set(draw(made_up(config))) == MAIN | {"views"}


def test_an_arc_goes_through_180_degrees_not_around(monkeypatch):
    results = made_up(Config(**SMALL, parts=("main",)))
    learners = [
        r for r in results.tables["policies"] if joined(*SHIPPED, "altruistic") in r["policy"]
    ]
    for row, angle in zip(learners, (170.0, 170.0, -170.0, -170.0), strict=True):
        row["angle"] = angle
    results.summary["policies"]["_".join((*SHIPPED, "altruistic"))]["angle"] = -178.0
    marks = []
    monkeypatch.setattr(intersection, "ring", lambda found, _: marks.extend(found) or Figure())
    fig_6_5(results)
    assert marks[-1].spread == (-190.0, -170.0)
