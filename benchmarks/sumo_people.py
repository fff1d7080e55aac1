"""People on foot in SUMO's crossing beside those of `intersection-crosswalk`, at equal demand.

    python benchmarks/sumo_people.py --out results/sumo-people

Each episode is driven in our core without an ego. Its vehicles enter SUMO's net at the same times,
places, speeds and ways, with the Intelligent Driver Model and highway-env's parameters, and its
people come to the same crosswalk from the same side at the same time and speed. Who has not
crossed at the end of an episode has the wait and delay until then. Needs the extra `sumo`.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from socialiq.results_folder import as_csv
from socialiq.worlds.registry import make
from socialiq.worlds.road_users import GONE, MOVING
from socialiq.worlds.sumo.network import NETS
from socialiq.worlds.sumo.simulation import SETTINGS, STEPS, library
from socialiq.worlds.sumo.traffic import Scene, SumoOptions

FIRST_SEED, EPISODES = 121_000_000, 60
SECONDS, COUNTED = 60, 40.0  # s of an episode; who come until then count
ARMS, OUTWARDS = "SWNE", ((0.0, -1.0), (-1.0, 0.0), (0.0, 1.0), (1.0, 0.0))  # north is up
LENGTH, STOP, CAR, FAR = 100.0, 11.0, 2.5, 20.0  # m, m from the middle, m, s
LIMIT, PACE = 10.0, 1.39  # m/s of every lane, of SUMO's pedestrians
OURS, SUMOS = 15.0, 9.5  # m from the middle of the junction to that of a crosswalk
QUANTITIES = {"wait": "s", "gap": "s", "delay": "s"}

Row = dict[str, Any]


class Car(NamedTuple):
    """Vehicle at a moment: place with north up, speed, and the arms of its way."""

    x: float
    y: float
    speed: float
    origin: int
    destination: int


def gap_of(cars: list[Car], arm: int, middle: float) -> float:
    """Return the seconds until the next moving vehicle is at a crosswalk; NaN if none is near."""
    seconds, (ux, uy) = [np.inf], OUTWARDS[arm]
    for car in cars:
        away, aside = car.x * ux + car.y * uy, car.x * uy - car.y * ux
        if car.origin == arm and away > middle:
            metres = away - middle
        elif car.destination == arm and away < middle:
            (ox, oy) = OUTWARDS[car.origin]
            before = max(car.x * ox + car.y * oy - STOP, 0.0)
            left = np.hypot(max(min(away, STOP), -STOP) - STOP, 0.0 if before else abs(aside))
            metres = before + left + middle - min(max(away, STOP), middle)
        else:
            continue
        if car.speed > 0.3:
            seconds.append(max(metres - CAR - 1.5, 0.0) / car.speed)
    return min(seconds) if min(seconds) < FAR else np.nan


class Demand(NamedTuple):
    """Traffic of one episode: vehicles as (time, record), and people."""

    vehicles: list[tuple[float, np.ndarray]]
    people: np.ndarray


def ours(seeds: list[int], spawning: float) -> Iterator[tuple[Demand, list[Row]]]:
    """Yield the demand of each episode, and a row for each person who came in time."""
    options = {"duration": float(SECONDS), "spawn_probability": spawning}
    world = make("intersection-crosswalk", **options)
    batch = world.batch(len(seeds), traced=True)
    batch.reset(np.array(seeds))
    dt = 1 / batch.options.simulation_frequency
    egos = batch.buffers.episodes["controlled"][:, 0]
    vehicles = batch.buffers.vehicles
    vehicles["y"][np.arange(len(seeds)), egos] += 1000.0  # the ego is nowhere near
    entered = [dict[int, tuple[float, np.ndarray]]() for _ in seeds]
    people = batch.buffers.people
    off = np.full(people.shape, np.nan)
    gaps, done = off.copy(), off.copy()
    for second in range(SECONDS):
        before = people.copy()
        batch.step(np.zeros(len(seeds), np.int64), auto_reset=False)
        for row, known in enumerate(entered):
            for slot in range(batch.buffers.episodes["vehicles"][row]):
                if slot != egos[row]:
                    record = vehicles[row, slot]
                    known.setdefault(int(record["identity"]), (second + 1.0, record.copy()))
        stepping = (before["state"] < MOVING) & (people["state"] >= MOVING)
        for row, number in np.argwhere(stepping):
            person = people[row, number]
            held = float(person["waited"] - before["waited"][row, number])
            off[row, number] = max(person["arrival"], second) + held
            frame = min(int((off[row, number] - second) / dt), batch.options.frames - 1)
            traced = batch.buffers.trace[row, frame]
            cars = [
                Car(
                    *(float(car[n]) for n in ("x", "y", "speed")), car["origin"], car["destination"]
                )
                for slot, car in enumerate(traced[: batch.buffers.episodes["vehicles"][row]])
                if slot != egos[row]
            ]
            gaps[row, number] = gap_of(cars, int(person["way"]) // 2, OURS)
        done[(people["state"] == GONE) & np.isnan(done)] = second + 1
    for row, known in enumerate(entered):
        table = list[Row]()
        for number, person in enumerate(people[row]):
            if person["arrival"] < COUNTED:
                end = SECONDS if np.isnan(off[row, number]) else off[row, number]
                wait, delay = end - person["arrival"], person["waited"]
                crossed = not np.isnan(done[row, number])
                measures = {"wait": wait, "gap": gaps[row, number], "delay": delay}
                who = {"world": "ours", "seed": seeds[row], "person": number, "crossed": crossed}
                table.append(who | measures)
        yield Demand(list(known.values()), people[row].copy()), table


def lines_of(demand: Demand) -> list[str]:
    """Return the demand as SUMO's XML, sorted by time."""
    lines = list[tuple[float, str]]()
    for time, car in demand.vehicles:
        left = max(abs(car["x"]), abs(car["y"])) - STOP
        if car["lane"] % 5 or left <= CAR:
            continue  # it is past its line already
        ways = [ARMS[car[end]] for end in ("origin", "destination")]
        lines.append((time, (
            f'<vehicle id="vehicle{car["identity"]}" type="vehicle" depart="{time:.1f}" '
            f'departLane="best" departPos="{LENGTH - left + CAR:.2f}" insertionChecks="none" '
            f'departSpeed="{min(car["speed"], LIMIT):.2f}" '
            f'speedFactor="{min(max(car["target_speed"] / LIMIT, 0.1), 1.0):.4f}">'
            f'<route edges="{ways[0]}C C{ways[1]}"/></vehicle>'
        )))  # fmt: skip
    for number, person in enumerate(demand.people):
        time, arm = float(person["arrival"]), int(person["way"]) // 2
        if time >= SECONDS:
            continue
        (ux, uy), (sx, sy) = OUTWARDS[arm], (float(person["along_x"]), -float(person["along_y"]))
        # An edge's sidewalk is on its right: of the way in, to the left of who looks outwards.
        from_in = -sx * uy + sy * ux < 0
        ends = (f"{ARMS[arm]}C", f"C{ARMS[arm]}")
        begin, end = ends if from_in else ends[::-1]
        places = (LENGTH - 1.0, 1.0) if from_in else (1.0, LENGTH - 1.0)
        lines.append((time, (
            f'<person id="pedestrian{number}" type="pedestrian" depart="{time:.1f}" '
            f'departPos="{places[0]}" speedFactor="{person["free_speed"] / PACE:.4f}">'
            f'<walk from="{begin}" to="{end}" arrivalPos="{places[1]}"/></person>'
        )))  # fmt: skip
    return [line for _, line in sorted(lines)]


def sumos(demand: Demand, seed: int) -> list[Row]:
    """Play the demand in SUMO; return a row for each person who came in time."""
    sumo, scene = library(), Scene(SumoOptions(following="IDM"))
    ways = {
        f"vehicle{car['identity']}": (car["origin"], car["destination"])
        for _, car in demand.vehicles
    }
    paces = {f"pedestrian{n}": float(p["free_speed"]) for n, p in enumerate(demand.people)}
    waits, walked, began, off, end, gaps = (dict[str, float]() for _ in range(6))
    with tempfile.TemporaryDirectory() as folder:
        routes = Path(folder) / "routes.rou.xml"
        routes.write_text("\n".join(["<routes>", *scene._types(), *lines_of(demand), "</routes>"]))
        settings = ["-n", str(NETS["crossing"]), "-r", str(routes), *SETTINGS]
        if sumo.isLoaded():
            sumo.load(settings)
        else:
            sumo.start(["sumo", *settings])
        for step in range(SECONDS * STEPS):
            sumo.simulationStep()
            now = (step + 1) / STEPS
            for name in sumo.person.getIDList():
                speed, road = sumo.person.getSpeed(name), sumo.person.getRoadID(name)
                began.setdefault(name, now)
                crossing = road.startswith(":C_c")
                if crossing and name not in off:
                    off[name] = now
                    arm = ARMS.index("NESW"[int(road[4])])  # of the shipped net's crossings
                    gaps[name] = gap_of(_cars(sumo, ways), arm, SUMOS)
                if name in off and not crossing:
                    end.setdefault(name, now)
                if name not in end:
                    walked[name] = walked.get(name, 0.0) + speed / STEPS
                    if name not in off and speed < 0.1 and now > began[name]:
                        waits[name] = waits.get(name, 0.0) + 1 / STEPS
    return [
        {
            "world": "SUMO", "seed": seed, "person": int(name.removeprefix("pedestrian")),
            "crossed": name in end, "wait": waits.get(name, 0.0), "gap": gaps.get(name, np.nan),
            "delay": end.get(name, SECONDS) - began[name] - walked[name] / paces[name],
        }
        for name in began
        if began[name] < COUNTED
    ]  # fmt: skip


def _cars(sumo: Any, ways: dict[str, tuple[int, int]]) -> list[Car]:
    cars = []
    for name in sumo.vehicle.getIDList():
        x, y = sumo.vehicle.getPosition(name)
        angle = np.deg2rad(sumo.vehicle.getAngle(name))
        place = x - 111.0 - CAR * np.sin(angle), y - 111.0 - CAR * np.cos(angle)
        cars.append(Car(*place, sumo.vehicle.getSpeed(name), *ways[name]))
    return cars


def distances(rows: list[Row]) -> list[Row]:
    """Return the two-sample distances of each quantity, and its quantiles in both."""
    table = list[Row]()
    for name in QUANTITIES:
        samples = [
            np.array([row[name] for row in rows if row["world"] == world], float)
            for world in ("ours", "SUMO")
        ]
        kept = [values[~np.isnan(values)] for values in samples]
        row: Row = {"quantity": name}
        for world, label in (("ours", "ours"), ("SUMO", "sumo")):
            left = [not row["crossed"] for row in rows if row["world"] == world]
            row[f"{label}_not_crossed"] = sum(left)
        for world, values, whole in zip(("ours", "sumo"), kept, samples, strict=True):
            low, middle, high = np.quantile(values, (0.15, 0.5, 0.85))
            row |= {f"{world}_n": len(values), f"{world}_none": len(whole) - len(values)}
            row |= {f"{world}_mean": values.mean(), f"{world}_15": low, f"{world}_50": middle}
            row |= {f"{world}_85": high}
        test = stats.ks_2samp(*kept)
        row |= {"ks": test.statistic, "ks_p": test.pvalue}
        row |= {"wasserstein": stats.wasserstein_distance(*kept)}
        table.append(row | {"energy": stats.energy_distance(*kept)})
    return table


def _rounded(row: Row, digits: int) -> Row:
    numbers = (float, np.floating)
    return {k: round(float(v), digits) if isinstance(v, numbers) else v for k, v in row.items()}


def main() -> None:
    """Compare and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--episodes", type=int, default=EPISODES)
    parser.add_argument("--spawn-probability", type=float, nargs="+", default=[0.3, 0.1])
    chosen = parser.parse_args()
    seeds = [FIRST_SEED + number for number in range(chosen.episodes)]
    rows, table = list[Row](), list[Row]()
    for spawning in chosen.spawn_probability:
        played = list[Row]()
        for seed, (demand, own) in zip(seeds, ours(seeds, spawning), strict=True):
            played += [*own, *sumos(demand, seed)]
        named = {"spawn_probability": spawning}
        rows += [named | row for row in played]
        table += [named | row for row in distances(played)]
    chosen.out.mkdir(parents=True, exist_ok=True)
    rounded = [_rounded(row, 4) for row in table]
    (chosen.out / "people.csv").write_text(as_csv([_rounded(row, 2) for row in rows]))
    (chosen.out / "distances.csv").write_text(as_csv(rounded))
    config = {"first_seed": FIRST_SEED, "episodes": chosen.episodes}
    config |= {"seconds": SECONDS, "counted_until": COUNTED, "libsumo": version("libsumo")}
    (chosen.out / "config.json").write_text(json.dumps(config, indent=1) + "\n")
    for row in rounded:
        print(row)


if __name__ == "__main__":
    main()
