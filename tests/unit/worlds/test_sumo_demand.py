"""Demand of a user in SUMO: explicit departures by class and time, and mistakes in a file."""

import pytest

from socialiq.errors import UserError
from socialiq.worlds.sumo.demand import read_demand
from socialiq.worlds.sumo.traffic import Scene, SumoOptions

GOOD = """<routes>
  <vType id="courier" vClass="bicycle" sigma="0.7"/>
  <flow id="a" begin="0" end="600" vehsPerHour="360" from="WC" to="CE"/>
  <flow id="b" type="courier" begin="10" end="20" number="4" from="NC" to="CS"/>
  <trip id="c" depart="12.5" from="EC" to="CN"/>
  <personFlow id="p" begin="0" end="600" period="100"><walk from="WC" to="CE"/></personFlow>
</routes>"""


def written(folder, text):
    (folder / "mine.rou.xml").write_text(text)
    return str(folder / "mine.rou.xml")


def test_flows_are_departures_at_equal_intervals_without_chance(tmp_path):
    demand = read_demand(written(tmp_path, GOOD))
    times = {kind: [] for kind in ("vehicle", "bicycle", "pedestrian")}
    for row in demand.departures:
        times[row.kind].append(row.time)
    assert times["vehicle"] == sorted([*(10.0 * step for step in range(60)), 12.5])
    assert times["bicycle"] == [10.0, 12.5, 15.0, 17.5]
    assert times["pedestrian"] == [100.0 * step for step in range(6)]
    assert 'sigma="0"' in demand.types[0] and 'speedDev="0"' in demand.types[0]
    assert len({row.line for row in demand.departures}) == 71


def test_an_episode_is_a_part_of_it_that_its_seed_draws(tmp_path):
    scene = Scene(SumoOptions(demand=written(tmp_path, GOOD), vehicle_rate=5.0))
    begins = {scene.begin(seed) for seed in range(20)}
    assert len(begins) > 10 and min(begins) >= 0.0 and max(begins) + scene.seconds <= 590.0
    begin, text = scene.begin(3), scene.demand(3, with_ego=True)
    assert f'id="ego" type="ego" depart="{begin + 15.0}"' in text
    assert 0 < text.count("<trip") + text.count("<person") < 71 * scene.seconds / 300


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("<routes>", "<net>"), "is not XML"),
        (('period="100"', 'period="exp(1)"'), "no times of departure as numbers"),
        (('depart="12.5"', 'depart="triggered"'), "no times of departure as numbers"),
        (('depart="12.5"', 'depart="12.5" departLane="random"'), "left to chance"),
        (("<trip ", "<vTypeDistribution "), "has <vTypeDistribution>, which is not read"),
        (("<walk from", "<ride from"), "has <ride>, which is not read"),
        (('number="4"', 'number="0"'), "no times of departure"),
        ((GOOD, "<routes/>"), "has no departures"),
        ((GOOD, "<net/>"), "has no <routes> but <net>"),
    ],
)
def test_a_mistake_is_told_in_one_line(tmp_path, change, message):
    with pytest.raises(UserError, match=message) as raised:
        read_demand(written(tmp_path, GOOD.replace(*change)))
    assert "\n" not in str(raised.value)
