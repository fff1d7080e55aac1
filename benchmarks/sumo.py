"""Decisions of a world in SUMO by second of processor time, beside plain libsumo.

    python benchmarks/sumo.py

Plain libsumo plays the same traffic, with the same ego, ten steps a decision, and reads nothing.
Ours reads every road user, keeps what each drives, and plays the same episode without the ego and
both to the common end. Both begin every episode from its start. Needs the extra `sumo`.
"""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from pathlib import Path

import gymnasium

import socialiq  # noqa: F401  registers the environments
from socialiq.worlds.sumo.simulation import SETTINGS, STEPS, library
from socialiq.worlds.sumo.traffic import EGO, Scene, SumoOptions

REPEATS, EPISODES, DECISIONS = 5, 20, 20


def plain(scene: Scene, folder: Path) -> float:
    """Return the decisions a second of libsumo alone."""
    sumo, count, routes = library(), 0, folder / "routes.rou.xml"
    begin = time.process_time()
    for seed in range(EPISODES):
        routes.write_text(scene.demand(seed, with_ego=True))
        settings = ["-n", str(scene.network.file), "-r", str(routes), *SETTINGS]
        sumo.load(settings) if sumo.isLoaded() else sumo.start(["sumo", *settings])
        for _ in range(round(scene.options.warm_up * STEPS) + 1):
            sumo.simulationStep()
        sumo.vehicle.setSpeedMode(EGO, 0)
        sumo.vehicle.setSpeed(EGO, 0.0)
        for _ in range(DECISIONS):
            for _ in range(STEPS):
                sumo.simulationStep()
            count += 1
    return count / (time.process_time() - begin)


def ours() -> tuple[float, float]:
    """Return the decisions a second of our environment, and the seconds simulated for each."""
    env = gymnasium.make("socialiq/Sumo-v1")
    count, seconds, begin = 0, 0.0, time.process_time()
    for seed in range(EPISODES):
        env.reset(seed=seed)
        ended = False
        while not ended:
            *_, terminated, truncated, _ = env.step(0)  # waits, so it takes all decisions
            count, ended = count + 1, terminated or truncated
        lasting = env.unwrapped.episode  # pyright: ignore[reportAttributeAccessIssue]
        seconds += 2 * (lasting.scene.options.warm_up + lasting.horizon)
    return count / (time.process_time() - begin), seconds / count


def main() -> None:
    """Measure both in turn, and print medians and their ratio."""
    scene = Scene(SumoOptions())
    with tempfile.TemporaryDirectory() as folder:
        plain(scene, Path(folder))
        pairs = [(plain(scene, Path(folder)), *ours()) for _ in range(REPEATS)]
    alone, with_pair, seconds = zip(*pairs, strict=True)
    print(
        json.dumps(
            {
                "libsumo_decisions_per_s": round(statistics.median(alone)),
                "ours_decisions_per_s": round(statistics.median(with_pair)),
                "ratio": round(statistics.median(o / a for a, o, _ in pairs), 3),
                "simulated_s_per_decision": {
                    "libsumo": (scene.options.warm_up + DECISIONS) / DECISIONS,
                    "ours": round(seconds[0], 2),
                },
            }
        )
    )


if __name__ == "__main__":
    main()
