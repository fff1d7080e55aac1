"""Files that are sound though unusual, as outsiders have them; refusals that the docs promise."""

import numpy as np
import pytest

from socialiq.errors import UserError
from socialiq_recordings.readers import import_file
from socialiq_recordings.readers.column_map import read_map
from socialiq_recordings.recording import RoadUser
from socialiq_recordings.road.network import Sign

LANE = (
    '<lanelet id="{0}"><leftBound><point><x>-5</x><y>4</y></point><point><x>40</x><y>4</y></point>'
    "</leftBound><rightBound><point><x>-5</x><y>0</y></point><point><x>40</x><y>{1}</y></point>"
    "</rightBound>{2}</lanelet>"
)
SIGN = (
    '<trafficSign id="9"><trafficSignElement><trafficSignID>{0}</trafficSignID>'
    "<additionalValue>{1}</additionalValue></trafficSignElement></trafficSign>"
)
SHAPE = "<shape><rectangle><length>4.5</length><width>1.8</width></rectangle></shape>"


def state(time, x, motion="<velocity><exact>8.0</exact></velocity>", heading="0.0", tag="state"):
    turned = f"<orientation><exact>{heading}</exact></orientation>" if heading else ""
    return (
        f"<{tag}><position><point><x>{x}</x><y>2.0</y></point></position>{turned}"
        f"<time><exact>{time}</exact></time>{motion}</{tag}>"
    )


def car(states, identity=2, kind="car", more=""):
    first = states[0].replace("<state>", "<initialState>").replace("</state>", "</initialState>")
    trajectory = f"<trajectory>{''.join(states[1:])}</trajectory>" if states[1:] else ""
    return (
        f'<dynamicObstacle id="{identity}"><type>{kind}</type>{SHAPE}{first}{trajectory}{more}'
        "</dynamicObstacle>"
    )


DRIVEN = [state(n, 0.8 * n) for n in range(21)]


@pytest.fixture
def scenario(tmp_path):
    def imported(*elements):
        path = tmp_path / "s.xml"
        head = '<commonRoad commonRoadVersion="2020a" benchmarkID="ZAM_A-1_1_T-1"'
        path.write_text(f'{head} timeStepSize="0.1">{"".join(elements)}</commonRoad>')
        return import_file(path)[0]

    return imported


@pytest.mark.parametrize(
    ("text", "limit"),
    [
        ("15mph", 6.7056),
        ("50kmh", 50 / 3.6),
        ("50 km/h", 50 / 3.6),
        ("13.9", 13.9),
        ("8 m/s", 8.0),
        ("fast", np.inf),
        ("", np.inf),
        ("-3", np.inf),
        ("nan", np.inf),
        ("१५", np.inf),
    ],
)
def test_a_speed_limit_is_read_or_named_and_refuses_nothing(scenario, text, limit):
    there = LANE.format(1, 0, '<trafficSignRef ref="9"/>')
    found = scenario(there, SIGN.format("274", text), car(DRIVEN))
    assert found.recording.road.lanelets[1].speed_limit == pytest.approx(limit)
    assert [fault.identity for fault in found.faults] == ["trafficSign 9"] * (limit == np.inf)
    of_lane = scenario(LANE.format(1, 0, f"<speedLimit>{text}</speedLimit>"), car(DRIVEN))
    assert of_lane.recording.road.lanelets[1].speed_limit == pytest.approx(limit)
    assert [fault.identity for fault in of_lane.faults] == ["lanelet 1"] * (limit == np.inf)


@pytest.mark.parametrize(
    "detail",
    [
        "<stopLine><point><x>1</x><y>2</y></point></stopLine>",
        '<adjacentLeft ref="5"/>',
        '<adjacentRight drivingDir="same"/>',
        "<successor/>",
        '<predecessor ref="first"/>',
        '<trafficSignRef ref="x"/>',
    ],
)
def test_details_of_a_lanelet_refuse_nothing(scenario, detail):
    found = scenario(LANE.format(1, 0, detail), car(DRIVEN))
    assert list(found.recording.road.lanelets) == [1] and found.recording.tracks.n_tracks == 1
    [fault] = found.faults
    assert fault.identity == "lanelet 1" and "invalid literal" not in fault.reason


@pytest.mark.parametrize(
    "element",
    [
        "<trafficSign><trafficSignElement/></trafficSign>",
        '<trafficSign id="x"/>',
        '<trafficLight id="9"><cycle><cycleElement><duration>0</duration><color>red</color>'
        "</cycleElement></cycle></trafficLight>",
        '<trafficLight id="9"><cycle><cycleElement><duration>5</duration><color>mauve</color>'
        "</cycleElement></cycle></trafficLight>",
        '<lanelet id="2"/>',
        LANE.format(1, 0, ""),
        LANE.format(2, 0, "").replace("<x>40</x>", "<x>-5</x>"),
        LANE.format(2, 4, "").replace("<y>0</y>", "<y>4</y>"),
    ],
)
def test_a_bad_element_of_the_road_is_left_out_and_named(scenario, element):
    found = scenario(LANE.format(1, 0, '<trafficLightRef ref="9"/>'), element, car(DRIVEN))
    assert list(found.recording.road.lanelets) == [1] and found.recording.tracks.n_tracks == 1
    assert len(found.faults) == 1
    # A light without a cycle that can be read is a light.
    light = found.recording.road.lanelets[1].sign == Sign.LIGHT
    assert light == element.startswith('<trafficLight id="9"')


def test_a_road_of_which_most_is_bad_refuses_the_file(scenario):
    flat = LANE.format(2, 4, "").replace("<y>0</y>", "<y>4</y>")
    with pytest.raises(UserError, match=r"lanelet 2: it is 0 m wide: .*\(and 1 more\)"):
        scenario(LANE.format(1, 0, ""), flat, flat, car(DRIVEN))


def test_a_state_that_is_repeated_exactly_counts_once(scenario):
    found = scenario(car([DRIVEN[0], *DRIVEN, DRIVEN[-1]]))
    assert found.recording.tracks.frame.tolist() == list(range(21))
    assert found.skipped == {"repeated state": 2} and found.refused == ()
    other = scenario(car([state(0, 0.1), *DRIVEN]), car(DRIVEN, 3))
    assert [refused.reason for refused in other.refused] == ["frame 0 is there twice"]


def test_states_of_point_masses(scenario):
    def masses(vx, vy):
        more = f"<velocity><exact>{vx}</exact></velocity><velocityY><exact>{vy}</exact></velocityY>"
        return [state(n, vx * n / 10, more, heading="") for n in range(12)]

    turned = state(0, 0.0, heading="1.0", motion="<velocity><exact>0.0</exact></velocity>")
    moving, standing = masses(6.0, 0.0), masses(0.0, 0.0)
    aside = [row.replace("<y>2", "<y>12") for row in (turned, *standing[1:])]
    fast = [row.replace("<y>2", "<y>22") for row in DRIVEN]
    found = scenario(car(moving, 1), car(standing, 2), car(aside, 3), car(fast, 4))
    tracks = found.recording.tracks
    assert tracks.identity.tolist() == [1, 3, 4]
    np.testing.assert_allclose(tracks.vx[:12], 6.0)
    np.testing.assert_allclose(tracks.heading[:12], 0.0, atol=1e-12)
    np.testing.assert_allclose(tracks.heading[12:24], 1.0)
    assert [(r.identity, r.reason[:15]) for r in found.refused] == [("2", "it never moves,")]


def test_point_masses_that_turn(scenario):
    angle = np.linspace(0.0, 0.3, 12)
    rows = [
        state(
            n,
            8 * n / 10,
            f"<velocity><exact>{8 * np.cos(a)}</exact></velocity>"
            f"<velocityY><exact>{8 * np.sin(a)}</exact></velocityY>",
            heading="",
        ).replace("<y>2.0</y>", f"<y>{np.sum(8 * np.sin(angle[: n + 1])) / 10}</y>")
        for n, a in enumerate(angle)
    ]
    tracks = scenario(car(rows)).recording.tracks
    np.testing.assert_allclose(tracks.heading, angle, atol=1e-12)
    np.testing.assert_allclose(np.hypot(tracks.vx, tracks.vy), 8.0)
    np.testing.assert_allclose(np.arctan2(tracks.vy, tracks.vx), angle, atol=1e-12)


def test_an_unknown_class_among_road_users_is_read_as_other(scenario):
    found = scenario(car(DRIVEN), car([row.replace("<y>2", "<y>12") for row in DRIVEN], 3, "tram"))
    assert found.recording.tracks.road_user.tolist() == [RoadUser.CAR, RoadUser.OTHER]
    assert found.skipped == {"unknown class": 1} and found.refused == ()
    [fault] = found.faults
    assert fault.identity == "3" and "type 'tram' is not among car, " in fault.reason
    with pytest.raises(UserError, match="type 'tram' is not among"):
        scenario(car(DRIVEN, kind="tram"))


OCCUPANCY = (
    "<occupancySet><occupancy><shape><circle><radius>3</radius></shape></occupancy></occupancySet>"
)


@pytest.mark.parametrize(
    ("element", "reason"),
    [
        (car(DRIVEN[:1], 3, more=OCCUPANCY.replace("</shape>", "</circle></shape>")), "a set of"),
        (car(DRIVEN, 3).replace("rectangle", "polygon"), "its shape is polygon"),
        (
            car(DRIVEN, 3).replace("<point>", "<circle/><point>"),
            "the position is a circle, not a point",
        ),
        (
            car(DRIVEN, 3).replace(
                "<time><exact>7</exact>",
                "<time><intervalStart>7</intervalStart><intervalEnd>8</intervalEnd>",
            ),
            "the time is an interval",
        ),
    ],
)
def test_what_the_docs_say_is_left_out(scenario, element, reason):
    found = scenario(car([row.replace("<y>2", "<y>9") for row in DRIVEN]), element)
    assert found.recording.tracks.identity.tolist() == [2]
    [refused] = found.refused
    assert refused.identity == "3" and reason in refused.reason


@pytest.mark.parametrize("kind", ["staticObstacle", "environmentObstacle", "phantomObstacle"])
def test_obstacles_of_other_kinds_are_counted(scenario, kind):
    found = scenario(car(DRIVEN), car(DRIVEN[:1], 3).replace("dynamicObstacle", kind))
    assert found.skipped == {kind: 1} and found.recording.tracks.identity.tolist() == [2]


HEAD = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"


def rows_of(who, speed=8.0, beside=2.0, kind="car", frames=range(1, 41)):
    return [
        f"{who},{n},{100 * n},{kind},{speed * n / 10:.2f},{beside},{speed},0.0,0.0,4.5,1.8"
        for n in frames
    ]


@pytest.fixture
def interaction(tmp_path):
    def imported(rows, head=HEAD, name="v.csv"):
        path = tmp_path / name
        path.write_text("\n".join([head, *rows]) + "\n")
        return import_file(path, "csv", read_map("interaction"))

    return imported


@pytest.mark.parametrize("blank", ["", "   ", ",,,,,,,,,,", "\t"])
def test_a_blank_row_is_no_row(interaction, blank):
    good = rows_of(1)
    [found] = interaction([*good[:5], blank, *good[5:], blank, blank])
    assert found.recording.tracks.n_states == found.n_states == 40
    assert found.skipped == {} and found.faults == () and found.refused == ()
    [gap] = interaction([*good, blank, *rows_of(2, frames=[1, 2, 4])])
    assert "row 45: frame 4 follows frame 2" in gap.refused[0].reason


def test_blank_rows_of_a_file_beside(tmp_path):
    head = "frame,id,x,y,width,height,xVelocity,yVelocity"
    rows = [f"{f},1,{f * 1.2},10.0,5.0,2.0,30.0,0.0" for f in range(1, 6)]
    (tmp_path / "01_tracks.csv").write_text("\n".join([head, *rows]))
    (tmp_path / "01_tracksMeta.csv").write_text("id,width,height,class\n1,5,2,Car\n\n\n\n")
    (tmp_path / "01_recordingMeta.csv").write_text("id,frameRate\n1,25\n\n\n")
    [found] = import_file(tmp_path / "01_tracks.csv", "csv", read_map("highd"))
    assert found.recording.tracks.n_states == 5


@pytest.mark.parametrize("again", [lambda r: [*r, *r], lambda r: [row for row in r for _ in "ab"]])
def test_rows_that_are_repeated_exactly_count_once(interaction, again):
    [found] = interaction(again(rows_of(1)))
    assert found.recording.tracks.frame.tolist() == list(range(1, 41)) and found.refused == ()
    assert found.skipped == {"repeated row": 40}
    [other] = interaction([*rows_of(1), *rows_of(2, beside=9.0), *rows_of(2, beside=9.1)])
    assert other.refused[0].identity == "2"


def test_cases_of_interaction_are_recordings(interaction):
    rows = [
        f"{case}.0,{row}"
        for case in (1, 2)
        for who in (1, 2)
        for row in rows_of(who, 8.0, 9.0 * who)
    ]
    first, second = interaction(rows, f"case_id,{HEAD}")
    assert [one.recording.tracks.recording for one in (first, second)] == ["v-1.0", "v-2.0"]
    assert first.recording.tracks.identity.tolist() == [1, 2] and second.n_states == 80


@pytest.mark.parametrize(
    ("words", "numbers"),
    [
        (("A1", "B1"), [1, 2]),
        (("P1", "P2"), [1, 2]),
        (("P2", "2"), [3, 2]),
        (("P3", "2"), [3, 2]),
        (("a1", "A1"), [1, 2]),
        (("car-1", "car-2"), [1, 2]),
        (("0f3c", "4a"), [1, 2]),
        (("1.0", "2"), [1, 2]),
        ((str(10**18), str(10**18 + 1)), [1, 2]),
        (("1_0", "10"), [11, 10]),
        (("१०", "10"), [11, 10]),
    ],
)
def test_two_names_are_two_road_users(interaction, words, numbers):
    one, other = (rows_of(word, 8.0, 2.0 + 9.0 * n) for n, word in enumerate(words))
    [found] = interaction([row for pair in zip(one, other, strict=True) for row in pair])
    tracks = found.recording.tracks
    by_lane = {int(tracks.y[tracks.starts[n]]): int(tracks.identity[n]) for n in range(2)}
    assert [by_lane[2], by_lane[11]] == numbers and found.refused == ()
    named = tracks.source.get("track_ids", {})
    assert all(named.get(str(n), word) == word for n, word in zip(numbers, words, strict=True))


def test_names_stand_in_reasons_and_in_the_file_beside(tmp_path):
    head = "frame,id,x,y,width,height,xVelocity,yVelocity"
    rows = [f"{f},A{n},{f * 1.2},{9.0 * n},5.0,2.0,30.0,0.0" for n in (1, 2) for f in range(1, 6)]
    rows += [f"{f},B1,{f * 1.2},30.0,5.0,2.0,30.0,0.0" for f in (1, 3)]
    (tmp_path / "01_tracks.csv").write_text("\n".join([head, *rows]))
    meta = "id,width,height,class\nB1,5,2,Truck\nA2,5,2,Truck\nA1,5,2,Car\n"
    (tmp_path / "01_tracksMeta.csv").write_text(meta)
    (tmp_path / "01_recordingMeta.csv").write_text("id,frameRate\n1,25\n")
    [found] = import_file(tmp_path / "01_tracks.csv", "csv", read_map("highd"))
    assert found.recording.tracks.road_user.tolist() == [RoadUser.CAR, RoadUser.TRUCK]
    assert found.refused[0].identity == "B1"


def test_a_row_without_a_class_has_that_of_the_others(interaction):
    rows = [*rows_of(1, frames=range(1, 5), kind=""), *rows_of(1, frames=range(5, 41))]
    [found] = interaction(
        [*rows, *rows_of(2, beside=9.0, kind="rickshaw"), *rows_of(3, beside=18.0)]
    )
    assert found.recording.tracks.road_user.tolist() == [0, RoadUser.OTHER, 0]
    [fault] = found.faults
    assert fault.identity == "2" and "class 'rickshaw' is not in the column map's" in fault.reason


def test_a_dropped_row_is_named(interaction):
    rows = rows_of(1)
    rows[39] = rows[39].replace(",2.0,", ",north,", 1)
    [found] = interaction([*rows, *rows_of(2, beside=9.0)])
    assert found.skipped == {"row": 1} and found.refused == ()
    assert found.faults[0].identity == "1" and "row 41: y is 'north'" in found.faults[0].reason
