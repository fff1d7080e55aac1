"""A third class of road users is one row of a table, from the world to pictures and the page.

`python -m tests.unit.worlds.test_third_class` prints what follows from the row, in a process of its
own, since the table is read where modules are imported.

A class that the product ships touches five files: `worlds/road_users.py` (the row),
`audit/profile/profile.schema.json` and `audit/report/report.schema.json` (written from the code),
its page in `docs/worlds` and `CHANGELOG.md`.
"""

import contextlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

EPISODES = 60
WORLD = "intersection,people=0.1,scooters=0.3,reward=caused"


def scooter() -> Any:
    """The row of a class that rides, with a size, speeds and weights of its own."""
    from socialiq.worlds.road_users import RIDES, InSumo, RoadUser

    return RoadUser(
        name="scooter",
        plural="scooters",
        key="scooters",
        motion=RIDES,
        length=1.2,
        width=0.6,
        arrivals={
            "rate": ("scooter_rate", 0.0),
            "speed": ("scooter_speed", 5.5),
            "speed_sd": ("scooter_speed_sd", 0.5),
            "gap": ("scooter_gap", 3.5),
            "gap_sd": ("scooter_gap_sd", 0.5),
            "least_gap": ("scooter_least_gap", 2.0),
            "impatience": ("scooter_impatience", 0.1),
            "rows": ("observed_scooters", 3),
        },
        weights={"delay": -0.4, "encounter": -1.0, "hit": -30.0, "collision": -40.0, "class": 2.0},
        most_delay=1.0,
        most_hit=0.01,
        sumo=InSumo("scooter", lanes="bicycle", rate=0.2, number=4, length=1.2),
        recorded="motorcycle",
    )


def driven() -> dict[str, Any]:
    """Return what a world with the class and one without it give, for `WORLD`."""
    from socialiq.worlds.registry import make

    world: Any = make(WORLD)
    batch = world.batch(EPISODES, traced=True)
    batch.reset(np.arange(EPISODES))
    rng = np.random.default_rng(0)
    before = world.options.narrow_rows[0]
    presence = set[float]()
    off = 0.0
    hits = 0.0
    for _ in range(15):
        running = batch.running
        decisions = batch.step(rng.integers(3, size=EPISODES), auto_reset=False, rows=running)
        presence |= {*np.unique(decisions.observation.reshape(EPISODES, -1, 7)[:, before:, 0])}
        signals = decisions.signals
        own = sum(signals[name] * weight for name, weight in world.options.social_weights.items())
        effects = world.effects
        caused = sum(
            getattr(effects, f"{name}_weight") * signals[name]
            for name in ("delay", "braking", "encounter")
        )
        caused = caused + effects.caused_collision_weight * signals["collision"]
        expected = np.sqrt(0.5) * (caused + own)
        off = max(off, float(np.abs(decisions.rewards.social - expected)[running].max()))
        hits += float(signals["scooter_hit"][running].sum())
    people = batch.buffers.people
    return {
        "presence": [float(code) for code in sorted(presence)],
        "signals": [name for name in signals if name.startswith("scooter")],
        "weights": world.reward["vulnerable"],
        "off": off,
        "hits": hits,
        "sizes": np.unique(people[people["kind"] == 2][["length", "width"]]).tolist(),
    }


def mixed() -> list[float]:
    """Return the metres between the middles of riders of an arm, of both classes that ride."""
    from socialiq.worlds.registry import make
    from socialiq.worlds.road_users import GONE, WAITING

    batch: Any = make("intersection,cyclists=0.2,scooters=0.2").batch(EPISODES)
    batch.reset(np.arange(EPISODES))
    gaps = list[float]()
    for _ in range(15):
        batch.step(np.zeros(EPISODES, np.int64), auto_reset=False, rows=batch.running)
        people = batch.buffers.people
        along = people["along_x"] * people["x"] + people["along_y"] * people["y"]
        there = (people["state"] >= WAITING) & (people["state"] < GONE)
        place = np.sort(np.where(there, 1000.0 * people["way"] + along, np.nan), axis=1)
        near = np.diff(place, axis=1)
        gaps += near[near < 100.0].tolist()
    return gaps


def measured() -> dict[str, Any]:
    """Return quantities of effects and of audits, by default bounds and in a report's tables."""
    from socialiq.audit.profile import fields
    from socialiq.audit.profile.template import limits_at
    from socialiq.evaluation.effects import QUANTITIES, caused, measure, summary
    from socialiq.evaluation.simulate import actor_of
    from socialiq.worlds.registry import make

    world: Any = make(WORLD)
    driver = world.driver("gap_3s")
    row = summary(measure(world, driver, range(EPISODES), judging=False))
    seeds = np.arange(EPISODES)
    episodes = caused(world, lambda batch: actor_of(batch, driver), seeds, EPISODES)
    names = ("scooter_delay", "scooter_hit")
    return {
        "summary": {name: row[name] for name in names},
        "quantities": [name for name in QUANTITIES if name in fields.QUANTITIES],
        "words": [fields.QUANTITIES[name].words for name in names],
        "fields": [field.path for field in fields.FIELDS if "scooter" in field.path],
        "episodes": {name: float(episodes[name].mean()) for name in names},
        "limits": limits_at(WORLD, 45.0, {"scooter_rate": 0.3}),
    }


def shown() -> dict[str, Any]:
    """Return what tables of options, pictures and the page have of the class."""
    from matplotlib.patches import Polygon

    from socialiq.cli.worlds import options_of
    from socialiq.foreign import drawing
    from socialiq.page.webassembly.layout import layout
    from socialiq.worlds.highway.render import present_scene, traffic
    from socialiq.worlds.registry import make
    from socialiq.worlds.road_users import MOVING

    world: Any = make("intersection,scooters=0.3")
    batch = world.batch(1)
    batch.reset([1])
    people = batch.buffers.people[0]
    people = people[people["kind"] == 2][:1].copy()
    people["state"] = MOVING
    bars = list[int]()
    for shown_people in (people[:0], people):
        axes = drawing().Figure().add_subplot()
        axes.set(xlim=(-60, 60), ylim=(60, -60))
        traffic(axes, present_scene(batch)._replace(people=shown_people), world.view)
        bodies = [patch for patch in axes.patches if patch.get_zorder() == 6]
        bars.append(sum(isinstance(body, Polygon) for body in bodies))
    options = {row["key"]: row for row in options_of("intersection")}
    return {
        "key": options["scooters, scooter_rate"]["meaning"],
        "gap": options["scooter_gap"],
        "lane": world.options.rides,
        "bars": bars[1] - bars[0],
        "page": layout(world.options)["people"]["classes"],
    }


def departures() -> list[str]:
    """Return the traffic of an episode in SUMO, as its types and departures."""
    from socialiq.worlds.sumo.traffic import Scene, SumoOptions

    return Scene(SumoOptions()).demand(3, with_ego=True).splitlines()


def simulated() -> dict[str, Any]:
    """Return what SUMO gets of the class, and its options, code and signals in SUMO."""
    from socialiq.evaluation.effects import IN_SUMO
    from socialiq.worlds.catalogue import keys_of
    from socialiq.worlds.sumo.gym import _CODES
    from socialiq.worlds.sumo.network import CLASSES
    from socialiq.worlds.sumo.traffic import SumoOptions

    return {
        "departures": departures(),
        "in_sumo": list(CLASSES),
        "by_class": len(SumoOptions(scooter_weight=3.0).by_class),
        "keys": [key for key in keys_of("sumo") if "scooter" in key],
        "code": _CODES["scooter"],
        "of_sumo": {name: IN_SUMO[name] for name in ("scooter_delay", "scooter_hit")},
    }


def recorded() -> dict[str, Any]:
    """Return the classes of people in recordings, and the group of their effects."""
    from socialiq_recordings.recording import GROUPS, PEOPLE

    return {"recorded": [GROUPS[kind] for kind in PEOPLE]}


def bounded() -> dict[str, Any]:
    """Return the bounds of a declaration that flags of the class give, and the defaults."""
    from socialiq.audit.profile.reader import load
    from socialiq.cli.main import main

    bounds = list[dict[str, float]]()
    for flags in ([], ["--max-scooter-delay", "2", "--scooter-delay-range", "0", "50"]):
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "profile.toml"
            words = ["profile", "new", "--world", WORLD, "--angle", "45", *flags]
            with contextlib.redirect_stdout(sys.stderr):
                assert main([*words, "--out", str(file)]) == 0
            caused = load(file).caused
        bounds.append({bound.path: bound.limit for bound in caused if "scooter" in bound.path})
    ends = [bound.range for bound in caused if bound.quantity == "scooter_delay"]
    return {"bounds": bounds, "ends": ends}


@pytest.fixture(scope="module")
def found():
    done = subprocess.run(
        [sys.executable, "-m", "tests.unit.worlds.test_third_class"],
        cwd=Path(__file__).parents[3],
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def test_its_people_have_their_size_and_own_rows_of_observations(found):
    assert found["sizes"] == [[1.2, 0.6]]
    assert found["presence"] == [0.0, 4.0]
    assert found["signals"] == ["scooter_delay", "scooter_encounter", "scooter_hit"]


def test_it_keeps_behind_riders_of_another_class(found):
    """Lengths of 1.2 and 1.8 m, half a metre apart, are 1.7 m between two of the shorter."""
    gaps = np.array(found["gaps"])
    assert len(gaps) > 300
    assert (gaps < 1.2).mean() < 0.01


def test_the_reward_weighs_it_by_weights_of_its_own(found):
    weights = found["weights"]
    assert weights["scooter_hit"] == 2 * -30.0 and weights["pedestrian_hit"] == -20.0
    assert "cyclist_hit" not in weights
    assert found["hits"] > 0 and found["off"] < 1e-9


def test_effects_and_audits_count_it(found):
    assert found["summary"]["scooter_delay"] > 0
    assert found["episodes"] == pytest.approx(found["summary"])
    assert found["quantities"][-2:] == ["scooter_delay", "scooter_hit"]
    assert found["words"] == ["makes scooters wait", "hits a scooter"]
    bounds = {"caused.max_scooter_delay", "caused.min_scooter_hit", "caused.scooter_delay_range"}
    assert bounds < {*found["fields"]}
    assert found["limits"]["max_scooter_delay"] == 1.0
    assert "max_cyclist_delay" not in found["limits"]


def test_options_pictures_and_the_page_show_it(found):
    assert found["key"] == "arrivals at each arm per s"
    assert found["gap"]["default"] == "3.5" and found["gap"]["needs"].endswith("or scooters")
    assert found["lane"] is True
    assert found["bars"] == 1
    assert found["page"] == ["pedestrians", "cyclists", "scooters"]


def test_sumo_has_it_and_the_departures_of_others_are_the_same(found):
    lines = found["departures"]
    assert '<vType id="scooter" vClass="bicycle" length="1.2" sigma="0" speedDev="0"/>' in lines
    assert sum('type="scooter"' in line for line in lines) > 3
    assert [line for line in lines if "scooter" not in line] == departures()
    assert found["in_sumo"] == ["vehicle", "bicycle", "pedestrian", "scooter"]
    assert found["by_class"] == 4
    assert found["keys"] == ["scooters", "scooter_rate", "scooter_weight"]
    assert found["code"] == 4.0
    signals = {"scooter_delay": "waiting_scooter", "scooter_hit": "collision_scooter"}
    assert found["of_sumo"] == signals


def test_recorded_junctions_replay_it(found):
    assert found["recorded"] == ["pedestrian", "bicycle", "motorcycle"]


def test_flags_of_a_declaration_bound_it(found):
    path = "caused.max_scooter_{}"
    usual, given = found["bounds"]
    assert usual == {path.format("delay"): 1.0, path.format("hit"): 0.01}
    assert given == {path.format("delay"): 2.0, path.format("hit"): 0.01}
    assert found["ends"] == [[0.0, 50.0]]


if __name__ == "__main__":
    from socialiq.worlds import road_users

    road_users.ROAD_USERS = (*road_users.ROAD_USERS, scooter())
    facts = driven() | measured() | shown() | simulated() | recorded() | bounded()
    print(json.dumps({**facts, "gaps": mixed()}))
