"""Grammar of worlds: names, keys and values, names of 0.3.0, and mistakes in one line."""

import dataclasses
import random

import pytest

from socialiq.errors import UserError
from socialiq.worlds import SUMO_IDS, catalogue
from socialiq.worlds.catalogue import OLD
from socialiq.worlds.grammar import build, parse
from socialiq.worlds.highway.effects import EffectOptions
from socialiq.worlds.highway.world import world_of
from socialiq.worlds.intersection.options import (
    ContinuousOptions,
    CrosswalkOptions,
    FleetOptions,
    Options,
)
from socialiq.worlds.intersection.world import Intersection
from socialiq.worlds.registry import make
from socialiq.worlds.spelled_out import declared

BUILT = {
    "intersection": Intersection(),
    "intersection,exit=right,spawn_probability=.6": Intersection(
        Options(destination="right", spawn_probability=0.6)
    ),
    "intersection,people=.2,class_angle=60": Intersection(
        CrosswalkOptions(pedestrian_rate=0.2, class_angle=60.0)
    ),
    "intersection,cyclists=.1": Intersection(
        CrosswalkOptions(pedestrian_rate=0.0, cyclist_rate=0.1)
    ),
    "intersection,reward=caused,delay_weight=-.2": Intersection(
        effects=EffectOptions(delay_weight=-0.2)
    ),
    "intersection,reward=thesis,control=discrete": Intersection(),
    "intersection,control=steering,offroad_terminal=true": Intersection(
        ContinuousOptions(actions="continuous_steering", offroad_terminal=True)
    ),
    "intersection,agents=3,ends=joint": Intersection(FleetOptions(agents=3, ends="joint")),
    "intersection,agents=1": Intersection(),
    "intersection,latency=1,unseen=.3": Intersection().shifted("latency=1,unseen=.3"),
    "intersection,late,wet or noise=1,wet": Intersection().shifted("late,wet or noise=1,wet"),
    "intersection,late,front_end=[latency=1,track=3]": Intersection().shifted(
        "late", "latency=1,track=3"
    ),
    "intersection, target_speeds=[0,5,10]": Intersection(Options(target_speeds=(0.0, 5.0, 10.0))),
    "merge,duration=30": world_of("merge", duration=30.0),
    "merge,agents=2": world_of("merge", agents=2),
    "merge,late": world_of("merge").shifted("late"),
    "roundabout,noise=1,front_end=[track=2]": world_of("roundabout").shifted("noise=1", "track=2"),
    "two_way,reward=caused,late or none": dataclasses.replace(
        world_of("two_way", shift="late or none"), effects=EffectOptions()
    ),
    "merge,reward=caused": dataclasses.replace(world_of("merge"), effects=EffectOptions()),
}


@pytest.mark.parametrize("text", BUILT)
def test_a_text_builds_the_world_of_its_options(text):
    assert build(text).description == BUILT[text].description


def test_gridworlds_have_short_words_too():
    assert build("crosswalk7,people=.3").options.pedestrian_probability == 0.3
    assert build("crossing7,braking=one_level").options.braking == "one_level"


@pytest.mark.parametrize("name", OLD)
def test_old_names_are_what_they_were(name):
    old, new = build(name), build(OLD[name])
    assert old.description == new.description
    assert old.reward_id == new.reward_id
    name_of, options = declared(OLD[name])
    assert (name_of, options) == declared(name)
    assert build(name_of, options).description == old.description


def test_declarations_keep_their_names():
    assert declared("intersection-crosswalk-60") == ("intersection-crosswalk", {"class_angle": 60})
    assert declared("crosswalk7") == ("crosswalk7", {"class_angle": 45.0})
    assert declared("intersection,control=steering") == ("intersection-continuous-steering", {})
    assert declared("intersection,reward=caused") == ("intersection-caused", {})
    assert declared("merge", {"duration": 30.0}) == ("merge", {"duration": 30.0})


def test_python_takes_the_same_words():
    assert make("intersection", people=0.1, latency=1) == build("intersection,people=.1,latency=1")
    assert make("intersection-crosswalk", cyclists=0.2).options.cyclist_rate == 0.2
    assert make("intersection,exit=left", exit="right").options.destination == "right"


def test_worlds_of_others_keep_their_keywords():
    assert parse("CartPole-v1,a=1,b=true,c=.5,d=x").options == {
        "a": 1, "b": True, "c": 0.5, "d": "x",
    }  # fmt: skip
    assert parse("sumo,demand=city.rou.xml,start=1,people=.1").options == {
        "demand": "city.rou.xml", "start": "1", "pedestrian_rate": 0.1,
    }  # fmt: skip


REFUSED = {
    "crossing7,noise=1": "crossing7 has no noise: a gridworld has no sensors",
    "crossing7,late": "crossing7 has no late: a gridworld has no sensors",
    "crossing7,people=.1": "people walk in crosswalk7",
    "crossing7,agents=2": "its other vehicles are rules",
    "merge,cyclists=.1": "merge has no cyclists: it has no bicycle lanes",
    "roundabout,control=continuous": "choose control=steering",
    "roundabout,exit=left": "its ego has one way",
    "sumo,noise=1": "SUMO tells each vehicle's true place",
    "sumo,reward=caused": "is what the ego causes already",
    "intersection,demand=a.rou.xml": "demand is of SUMO",
    "intersection,class_angle=60": "class_angle needs people=0.1",
    "intersection,delay_weight=1": "add reward=caused",
    "intersection,ends=joint": "ends needs agents=2",
    "intersection,offroad_terminal=true": "needs control=continuous",
    "intersection,reward=caused,agents=2": "set agents=1",
    "merge,dense": "merge has no option initial_vehicle_count, which the shift cars=10,spawn=0.6",
    "nowhere.safetensors,late": "a recording can't be driven in",
    "intersection,cycilsts=.1": "did you mean cyclists",
    "intersection,people": "'people' is no KEY=VALUE",
    "intersection,people=.1,people=.2": "given twice",
    "intersection,exit=left,destination=left": "one option of intersection",
    "intersection,people=lots": "people must be a number",
    "intersection,agents=x": "agents must be an integer",
    "intersection,exit=up": "choose one of right, left",
    "intersection,reward=good": "choose one of thesis, caused",
    "intersection,,": "leave it out",
    "crossing9": "choose one of crossing5",
    "CartPole-v1": "make_environment",
}


@pytest.mark.parametrize("text", REFUSED)
def test_mistakes_name_the_mend(text):
    with pytest.raises(UserError) as error:
        build(text)
    assert REFUSED[text] in str(error.value)
    assert "\n" not in str(error.value)


def test_any_text_is_a_world_or_a_mistake():
    rng = random.Random(5)
    keys = [key for name in catalogue.NAMES for key in catalogue.keys_of(name)]
    values = ["1", "-1", "nan", "1e999", "true", "", "x", "[", "[1,2", "]", "'", '"', "٣", "late"]
    names = [*catalogue.NAMES, *OLD, *SUMO_IDS, "", " ", "a.net.xml", "x" * 5000, "\0", "a:b", "é"]
    for _ in range(3000):
        words = [rng.choice(names)]
        for _ in range(rng.randrange(4)):
            word = f"{rng.choice(keys)}{rng.choice(['=', '', '==', ' = '])}{rng.choice(values)}"
            words.append(rng.choice([word, "late or noise=1", " or ", rng.choice(values)]))
        try:
            build(",".join(words))
        except UserError as error:
            assert "\n" not in str(error), words
