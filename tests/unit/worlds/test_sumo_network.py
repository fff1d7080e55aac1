"""Networks of SUMO: ways through those that ship, and mistakes in others; nothing is simulated."""

import pytest

from socialiq.errors import UserError
from socialiq.worlds.sumo.network import NETS, read_network
from socialiq.worlds.sumo.traffic import Scene, SumoOptions


def test_the_crossing_has_the_ways_of_the_intersection():
    network = read_network("crossing")
    routes = network.routes()
    assert len(routes) == 12 and routes["SC", "CW"] == ["SC", "CW"]
    assert network.edges["SC"].length == 100.0  # and stop lines 11 m from the middle
    assert network.junctions["C"][1].tolist() == [111.0, 111.0]
    assert [*network.crossings.values()] == [4]
    assert Scene(SumoOptions()).way == ["SC", "CW"]  # to the left from the road that gives way


def test_ways_lead_through_the_row():
    routes = read_network("row").routes()
    assert routes["WC0", "C2N2"] == ["WC0", "C0C1", "C1C2", "C2N2"]
    assert len(routes) == 8 * 7


def test_departures_of_a_class_do_not_move_those_of_another():
    def lines(kind, **options):
        text = Scene(SumoOptions(**options)).demand(3, with_ego=False)
        return [line for line in text.splitlines() if f'id="{kind}' in line and "vType" not in line]

    assert lines("vehicle") == lines("vehicle", pedestrian_rate=2.0, bicycle_rate=0.0)
    assert len(lines("pedestrian", pedestrian_rate=2.0)) > 2 * len(lines("pedestrian"))
    assert lines("vehicle") != lines("vehicle", start="NC", duration=30.0)


def without_crossings(text):
    return text.replace('function="crossing"', 'function="internal"')


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:-20], "is not XML"),
        (lambda text: "<routes/>", "has no <net> but <routes>"),
        (lambda text: text.replace(' length="100.00"', ""), "lacks 'length' somewhere"),
        (lambda text: text.replace("<connection ", "<link "), "no way on which a car enters"),
        (lambda text: text.replace('disallow="pedestrian bicycle"', 'allow="tram"'), "no way on"),
    ],
)
def test_a_mistake_in_a_network_is_told_in_one_line(tmp_path, change, message):
    file = tmp_path / "mine.net.xml"
    file.write_text(change(NETS["crossing"].read_text()))
    with pytest.raises(UserError, match=message) as raised:
        read_network(str(file))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("word", "is_left"),
    [("true", True), ("1", True), ("Yes", True), ("false", False), ("0", False)],
)
def test_the_side_of_the_traffic_is_that_of_the_network(tmp_path, word, is_left):
    file = tmp_path / "mine.net.xml"
    file.write_text(NETS["crossing"].read_text().replace("<net ", f'<net lefthand="{word}" '))
    scene = Scene(SumoOptions(net=str(file)))
    assert scene.network.left_hand == is_left
    assert scene.way == ["SC", "CE" if is_left else "CW"]  # across oncoming traffic


def test_without_crossings_nobody_walks(tmp_path):
    file = tmp_path / "mine.net.xml"
    file.write_text(without_crossings(NETS["crossing"].read_text()))
    assert read_network(str(file)).walks("pedestrian") == []
    assert len(read_network("crossing").walks("pedestrian")) == 8 * 6


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"net": "moon"}, "unknown network 'moon': choose one of crossing, row, or"),
        ({"net": "nowhere.net.xml"}, "no such file"),
        ({"start": "CW"}, "no way of a car from 'CW' to ''"),
        ({"vehicle_rate": 11.0}, "vehicle_rate must lie between 0 and 10"),
        ({"pedestrian_rate": float("nan")}, "pedestrian_rate must lie"),
        ({"pedestrian_weight": float("inf")}, "weights of classes must be finite"),
        ({"warm_up": -1.0}, "warm_up must lie"),
        ({"horizon": 10.0}, "horizon must be at least"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(UserError, match=message):
        Scene(SumoOptions(**options))
