"""Scenarios written by hand in both versions, and everything that can be wrong with one."""

import re
import tracemalloc

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.readers import commonroad_xml
from socialiq_recordings.readers.commonroad import read_commonroad
from socialiq_recordings.recording import RoadUser
from socialiq_recordings.road.network import Colour, Cycle, Sign


def exact(name, value):
    return f"<{name}><exact>{value}</exact></{name}>"


def state(time, x, y=0.0, speed=5.0, heading="0.0", name="state", more=""):
    velocity = "" if speed is None else exact("velocity", speed)
    position = f"<position><point><x>{x}</x><y>{y}</y></point></position>"
    orientation = exact("orientation", heading) if heading else ""
    return f"<{name}>{position}{orientation}{exact('time', time)}{velocity}{more}</{name}>"


RECTANGLE = "<rectangle><length>4.5</length><width>1.8</width></rectangle>"


def obstacle(identity, states, kind="car", shape=RECTANGLE, tag="dynamicObstacle", head=""):
    first, *rest = states
    first = first.replace("<state>", "<initialState>").replace("</state>", "</initialState>")
    trajectory = f"<trajectory>{''.join(rest)}</trajectory>" if rest else ""
    return (
        f'<{tag} id="{identity}">{head}<type>{kind}</type><shape>{shape}</shape>{first}'
        f"{trajectory}</{tag}>"
    )


def driven(frames=range(3), speed=5.0):
    return [state(frame, 0.5 * frame, speed=speed) for frame in frames]


def bounds(y, points=2):
    xs = np.linspace(0, 50, points)
    left = "".join(f"<point><x>{x}</x><y>{y + 3}</y></point>" for x in xs)
    right = "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x in xs)
    return f"<leftBound>{left}</leftBound><rightBound>{right}</rightBound>"


def scenario(*things, version="2020a", step="0.1", name="ZAM_T-1_1_T-1"):
    return (
        f'<?xml version="1.0"?><commonRoad benchmarkID="{name}" commonRoadVersion="{version}" '
        f'timeStepSize="{step}" source="made by hand">{"".join(things)}</commonRoad>'
    )


@pytest.fixture
def read(tmp_path):
    def made(text, **options):
        path = tmp_path / "s.xml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_commonroad(path, **options)

    return made


def test_states_become_rows(read):
    imported = read(
        scenario(
            obstacle(7, [state(4, 1.0, 2.0, 3.0, "1.5"), state(5, 1.5, 2.5, 3.5, "1.6")], "truck"),
            obstacle(9, [state(0, 8.0)], "taxi"),
        )
    )
    tracks = imported.recording.tracks
    assert tracks.identity.tolist() == [7, 9] and tracks.frame.tolist() == [4, 5, 0]
    assert tracks.x.tolist() == [1.0, 1.5, 8.0] and tracks.y.tolist() == [2.0, 2.5, 0.0]
    assert tracks.heading.tolist() == [1.5, 1.6, 0.0]
    np.testing.assert_allclose(tracks.vx, [3 * np.cos(1.5), 3.5 * np.cos(1.6), 5.0])
    np.testing.assert_allclose(tracks.vy, [3 * np.sin(1.5), 3.5 * np.sin(1.6), 0.0])
    assert tracks.road_user.tolist() == [RoadUser.TRUCK, RoadUser.CAR]
    assert tracks.length.tolist() == [4.5, 4.5] and tracks.width.tolist() == [1.8, 1.8]
    assert tracks.dt == 0.1 and tracks.recording == "ZAM_T-1_1_T-1"
    assert tracks.source["source"] == "made by hand" and len(tracks.source["sha256"]) == 64
    assert imported.n_states == 3 and imported.refused == () and imported.skipped == {}


def test_the_older_version_says_dynamic_by_a_role(read):
    things = (
        obstacle(7, driven(), tag="obstacle", head="<role>dynamic</role>"),
        obstacle(8, [state(0, 9.0)], tag="obstacle", head="<role>static</role>"),
        f'<planningProblem id="5">{state(0, 1.0, name="initialState")}<goalState>'
        '<position><lanelet ref="1"/></position></goalState></planningProblem>',
    )
    imported = read(scenario(*things, version="2018b"))
    assert imported.recording.tracks.identity.tolist() == [7]
    assert imported.recording.tracks.n_states == 3
    assert imported.skipped == {"staticObstacle": 1, "planningProblem": 1}


def test_intervals_slip_and_missing_velocities(read):
    between = "<velocity><intervalStart>4</intervalStart><intervalEnd>6</intervalEnd></velocity>"
    tracks = read(
        scenario(
            obstacle(1, [state(0, 0.0, speed=None, more=between)]),
            obstacle(2, [state(0, 0.0, speed=2.0, more=exact("slipAngle", np.pi / 2))]),
            obstacle(3, driven(speed=None)),
            obstacle(4, [state(0, 0.0, heading="4.0")]),
        )
    ).recording.tracks
    np.testing.assert_allclose(tracks.vx, [5.0, 0.0, 5.0, 5.0, 5.0, 5 * np.cos(4.0)], atol=1e-12)
    np.testing.assert_allclose(tracks.vy[:3], [0.0, 2.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(tracks.heading[-1], 4.0 - 2 * np.pi)
    assert tracks.source["intervals"] == 1


def test_an_acceleration_is_no_velocity(read):
    accelerated = state(0, 0.0, speed=None, more=exact("acceleration", 3.0))
    assert read(scenario(obstacle(1, [accelerated]))).recording.tracks.vx.tolist() == [0.0]


SIGN = (
    '<trafficSign id="{0}"><trafficSignElement><trafficSignID>{1}</trafficSignID>{2}'
    "</trafficSignElement></trafficSign>"
)


def test_the_road_has_its_neighbours_signs_and_limits(read):
    limit = "<additionalValue>8.5</additionalValue>"
    things = (
        f'<lanelet id="1">{bounds(0)}<predecessor ref="4"/><successor ref="2"/><successor ref="3"/>'
        '<adjacentLeft ref="5" drivingDir="opposite"/><adjacentRight ref="6" drivingDir="same"/>'
        "<stopLine><lineMarking>solid</lineMarking></stopLine>"
        '<trafficSignRef ref="20"/><trafficSignRef ref="21"/></lanelet>',
        f'<lanelet id="2">{bounds(5)}<trafficSignRef ref="20"/><trafficLightRef ref="22"/>'
        "<stopLine><point><x>1</x><y>2</y></point><point><x>3</x><y>4</y></point></stopLine>"
        "</lanelet>",
        f'<lanelet id="3">{bounds(9, 4)}<speedLimit>13.4</speedLimit>'
        '<trafficLightRef ref="23"/></lanelet>',
        SIGN.format(20, "205", ""),
        SIGN.format(21, "274", limit),
        '<trafficLight id="22"><active>true</active></trafficLight>',
        '<trafficLight id="23"><active>false</active></trafficLight>',
        obstacle(7, driven()),
    )
    lanelets = read(scenario(*things)).recording.road.lanelets
    one, two, three = lanelets.values()
    assert one.successors == (2, 3) and one.predecessors == (4,)
    assert one.adjacent_left == (5, False) and one.adjacent_right == (6, True)
    assert one.sign == Sign.YIELD and one.speed_limit == 8.5
    assert one.stop_line is not None and one.stop_line.tolist() == [[50.0, 3.0], [50.0, 0.0]]
    # The light stands above the sign; a dark one says nothing.
    assert two.sign == Sign.LIGHT and two.stop_line is not None and two.speed_limit == np.inf
    assert two.stop_line.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert three.sign == Sign.NONE and three.speed_limit == 13.4 and len(three.left) == 4
    np.testing.assert_array_equal(one.centre, [[0.0, 1.5], [50.0, 1.5]])


def light(identity, *phases, offset="", active="true"):
    cycle = "".join(
        f"<cycleElement><duration>{length}</duration><color>{color}</color></cycleElement>"
        for color, length in phases
    )
    offset = f"<timeOffset>{offset}</timeOffset>" if offset else ""
    return (
        f'<trafficLight id="{identity}"><cycle>{cycle}{offset}</cycle>'
        f"<active>{active}</active></trafficLight>"
    )


def test_cycles_of_lights(read):
    def lane(identity, *lights):
        named = "".join(f'<trafficLightRef ref="{one}"/>' for one in lights)
        return f'<lanelet id="{identity}">{bounds(5 * identity)}{named}</lanelet>'

    phases = ("red", 30), ("redYellow", 5), ("green", 20), ("yellow", 5), ("inactive", 40)
    things = (
        *(lane(1, 20), lane(2, 21), lane(3, 22), lane(4, 20, 21), lane(5, 20, 23)),
        light(20, *phases, offset="10"),
        light(21, ("green", 7)),
        light(22, ("red", 7), active="false"),
        light(23, *phases, offset="10"),
        obstacle(7, driven()),
    )
    one, two, three, four, five = read(scenario(*things)).recording.road.lanelets.values()
    assert one.sign == Sign.LIGHT and one.cycle is not None
    seen = [one.cycle.at(frame) for frame in (9, 10, 39, 40, 45, 65, 70, 109, 110)]
    assert seen[:3] == [Colour.INACTIVE, Colour.RED, Colour.RED]
    assert seen[3:6] == [Colour.RED_YELLOW, Colour.GREEN, Colour.YELLOW]
    assert seen[6:] == [Colour.INACTIVE, Colour.INACTIVE, Colour.RED]
    assert [one.cycle.closed(frame) for frame in (10, 40, 45, 65, 70)] == [1, 1, 0, 1, 0]
    assert two.cycle == Cycle(((Colour.GREEN, 7),)) and three.cycle is None
    # Lights that differ are of different directions; equal ones are one light.
    assert four.cycle is None and five.cycle == one.cycle


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (light(20, ("purple", 7)), "no 'purple'"),
        (light(20, ("red", 0)), "a frame or more"),
        (light(20, ("red", "x")), "'x'"),
        (light(20, ("red", 7), offset="x"), "'x'"),
        (light(20, ("red", 2_000_000)), "together at most"),
    ],
)
def test_a_cycle_that_is_none_is_left_out_and_named(read, wrong, reason):
    lane = f'<lanelet id="1">{bounds(0)}<trafficLightRef ref="20"/></lanelet>'
    found = read(scenario(lane, wrong, GOOD))
    assert found.recording.road.lanelets[1].sign == Sign.LIGHT
    assert found.recording.road.lanelets[1].cycle is None
    [fault] = found.faults
    assert fault.identity == "trafficLight 20" and reason in fault.reason


GOOD = obstacle(1, driven())


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (obstacle(2, driven([0, 1, 3])), "frame 3 follows frame 1: a gap of 1"),
        (obstacle(2, driven([0, 2, 1])), "frame 2 follows frame 0: a gap of 1"),
        (obstacle(2, driven([3, 2])), "time goes back: frame 2 follows frame 3"),
        (obstacle(2, [*driven([0]), state(0, 0.1)]), "frame 0 is there twice"),
        (obstacle(2, driven([-1, 0])), "frame -1 is negative"),
        (obstacle(2, [state(0, "nan")]), "state of time 0: a value is missing, not finite"),
        (obstacle("two", driven()), "its id is not a whole number of 64 bits"),
        (obstacle("1" * 31, driven()), "its id is not a whole number of 64 bits"),
        (GOOD, "two obstacles have this id"),
        (obstacle(2, [state(0, "x")]), "could not convert string to float: 'x'"),
        (obstacle(2, [state(0, 1.0, heading="")]), "state of time 0: no orientation"),
        (obstacle(2, [state("0.5", 1.0)]), "state of time 0.5"),
        (obstacle(2, [state("1" * 31, 1.0)]), "has more than 64 bits"),
        (obstacle(2, driven(), shape="<polygon/>"), "its shape is polygon"),
        (obstacle(2, driven(), shape=""), "its shape is missing"),
        (obstacle(2, driven(), shape=RECTANGLE.replace("4.5", "-1")), "its length or width is not"),
        (
            obstacle(
                2, driven(), shape=RECTANGLE.replace("<l", "<originXShift>1</originXShift><l")
            ),
            "does not lie around its position",
        ),
        (obstacle(2, driven()).replace("<point>", "<circle/><point>"), "the position is a circle"),
    ],
)
def test_a_bad_track_is_left_out_with_its_reason(read, bad, reason):
    imported = read(scenario(GOOD, bad, obstacle(3, driven())))
    assert imported.recording.tracks.identity.tolist() == [1, 3]
    assert imported.recording.tracks.x.tolist() == [0.0, 0.5, 1.0] * 2
    [refused] = imported.refused
    assert f'<dynamicObstacle id="{refused.identity}">' in bad and reason in refused.reason


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "is empty"),
        ("<commonRoad", "line 1: not XML"),
        (scenario(GOOD)[:-20], "not XML"),
        ("<osm/>", "its first element is osm"),
        ("<?xml version='1.0' encoding='utd-8'?><osm/>", "unknown encoding: utd-8: save the file"),
        ("<?xml version='1.0' encoding='gb18030'?><osm/>", "encoding.*: save the file as UTF-8"),
        (
            scenario(GOOD, version="2024z"),
            "version '2024z', not one of 2017a, 2017b, 2018a, 2018b, 2020a",
        ),
        (scenario(GOOD, step="0"), "timeStepSize"),
        (scenario(GOOD, step="fast"), "timeStepSize"),
        (
            scenario(GOOD, f'<lanelet id="{"1" * 31}">{bounds(0)}</lanelet>'),
            "lanelet 1+…: 1+… has more than 64 bits",
        ),
        (scenario(), "no track can be used$"),
        (
            scenario(obstacle(2, driven([3, 2]))),
            "can be used; the first, 2: time goes back",
        ),
        (scenario(GOOD, f'<lanelet id="4">{bounds(0)}</lanelet>' * 3), "lanelet 4: two lanelets"),
        (scenario(obstacle(2, driven(), kind="dragon")), "type 'dragon' is not among"),
        (scenario(GOOD, '<lanelet id="4"/>'), "lanelet 4: no 'bound on one side'"),
        (
            scenario(GOOD, f'<lanelet id="4">{bounds(0, 1)}</lanelet>'),
            r"xml: lanelet 4: its bounds have 1 and 1",
        ),
        (scenario(GOOD, f"<lanelet>{bounds(0)}</lanelet>"), "no 'id'"),
        (scenario(GOOD.replace("<state>", "<state><state>")), "not XML"),
        (
            scenario(GOOD.replace("</state>", "<state></state></state>")),
            "a state inside a state|not XML",
        ),
        (scenario("<a>" * 100 + "</a>" * 100), "nested too deep"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(read, tmp_path, text, line):
    with pytest.raises(UserError, match=line) as caught:
        read(text)
    assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)


BILLION = (
    '<!DOCTYPE commonRoad [<!ENTITY a "aaaaaaaaaa">'
    + "".join(
        f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefghi", "bcdefghij", strict=True)
    )
    + "]>"
)


@pytest.mark.parametrize(
    "doctype",
    [
        BILLION,
        '<!DOCTYPE commonRoad [<!ENTITY a SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE commonRoad SYSTEM "http://127.0.0.1:9/x.dtd">',
        "<!DOCTYPE commonRoad>",
    ],
)
def test_document_types_are_refused_before_any_entity(read, doctype):
    text = scenario(GOOD.replace("<x>0.0</x>", "<x>&j;</x>"))
    with pytest.raises(UserError, match="declares a document type"):
        read(text.replace("?>", f"?>{doctype}", 1))


def test_undeclared_entities_are_not_xml(read):
    with pytest.raises(UserError, match="undefined entity"):
        read(scenario(GOOD.replace("<x>0.0</x>", "<x>&j;</x>")))


@pytest.mark.parametrize("huge", ["<note>" + "a" * (1 << 18) + "</note>", "<a/>" * (1 << 12)])
def test_an_element_without_end_is_refused_early(read, monkeypatch, huge):
    monkeypatch.setattr(commonroad_xml, "_CHUNK", 1 << 10)
    monkeypatch.setattr(commonroad_xml, "_MOST_BYTES", 1 << 13)
    with pytest.raises(UserError, match="one element is larger than"):
        read(scenario(GOOD, f"<location>{huge}</location>"))


def test_text_may_lie_across_the_pieces_that_are_read(read, monkeypatch):
    text = scenario(*[obstacle(one, driven(range(one, one + 3))) for one in range(1, 6)])
    whole = read(text).recording.tracks
    for size in (1, 2, 3, 5, 64):
        monkeypatch.setattr(commonroad_xml, "_CHUNK", size)
        found = read(text).recording.tracks
        for name, column in whole.arrays().items():
            np.testing.assert_array_equal(getattr(found, name), column)


def test_more_states_than_allowed_are_refused_before_they_fill_the_memory(read):
    text = scenario(*[obstacle(one, driven()) for one in range(10)])
    assert read(text, most_states=30).recording.tracks.n_states == 30
    with pytest.raises(UserError, match=re.escape("more than 29 states")) as caught:
        read(text, most_states=29)
    assert "--most-states" in str(caught.value)


def test_memory_is_linear_in_the_states_and_below_the_file(read, monkeypatch):
    monkeypatch.setattr(commonroad_xml, "_CHUNK", 1 << 12)

    def peak(n):
        text = scenario(*[obstacle(one, driven(range(50))) for one in range(n)]).encode()
        tracemalloc.start()
        read(text)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found, len(text)

    read(scenario(GOOD))  # whatever is imported late
    (small, _), (large, size) = peak(10), peak(40)
    assert large < 4.4 * small
    # A state is 190 bytes of text here and 48 of a row, which is copied when the table is made.
    assert large < size
