"""Elements and attributes of a user's network or demand that reach SUMO; all others are left out.

SUMO writes any file that a parameter names (`device.ssm.file` of a vehicle type, `file` of a
traffic light), and reads any file that an `<include>` names. So SUMO never gets a user's file: it
gets a copy that holds what these tables list. No listed attribute names a file, and `<param>` is in
no table. The tables follow net_file.xsd and route.xsd of SUMO 1.28.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple
from xml.etree.ElementTree import Element

from socialiq.foreign import one_line


class Allowed(NamedTuple):
    """Element that may reach SUMO.

    Attributes:
        attributes: Names of its attributes.
        children: Its children by name.
    """

    attributes: frozenset[str]
    children: Mapping[str, Allowed]


def _allowed(attributes: str, **children: Allowed) -> Allowed:
    return Allowed(frozenset(attributes.split()), children)


_STOP = _allowed(
    "lane edge startPos endPos posLat friendlyPos arrival duration until extension index parking "
    "triggered permitted expected speed jump jumpUntil"
)
_ROUTE = _allowed("id edges repeat cycleTime", stop=_STOP)
_WALK = _allowed(
    "route edges from to fromJunction toJunction via departPos arrivalPos speed duration "
    "departPosLat arrivalPosLat"
)
_PERSON_TRIP = _allowed(
    "from to fromJunction toJunction via modes vTypes walkFactor departPos arrivalPos"
)
_TIMES_OF_FLOWS = "begin end number period vehsPerHour perHour personsPerHour probability"
_DRIVING = (
    "id type route from to via fromJunction toJunction viaJunctions depart departLane departPos "
    "departSpeed departEdge departPosLat arrivalLane arrivalPos arrivalSpeed arrivalEdge "
    "arrivalPosLat speedFactor insertionChecks reroute"
)
_WALKING = "id type depart departPos speedFactor"

DEMAND: Mapping[str, Allowed] = {
    "vType": _allowed(
        "id vClass length minGap width height mass maxSpeed desiredMaxSpeed speedFactor speedDev "
        "accel decel emergencyDecel apparentDecel maxAccelProfile desAccelProfile sigma sigmaStep "
        "tau delta stepping carFollowModel laneChangeModel actionStepLength impatience "
        "maxSpeedLat minGapLat latAlignment personCapacity boardingDuration startupDelay scale "
        "timeToTeleport "
        # Parameters of models of car-following.
        "adaptTime adaptFactor tmp1 tmp2 tmp3 tmp4 tmp5 tauLast apProb k phi security estimation "
        "speedControlGain speedControlMinGap gapClosingControlGainSpeed "
        "gapClosingControlGainSpace gapControlGainSpeed gapControlGainSpace "
        "collisionAvoidanceGainSpeed collisionAvoidanceGainSpace tauCACCToACC "
        "speedControlGainCACC gapClosingControlGainGap gapClosingControlGainGapDot "
        "gapControlGainGap gapControlGainGapDot collisionAvoidanceGainGap "
        "collisionAvoidanceGainGapDot cc1 cc2 cc3 cc4 cc5 cc6 cc7 cc8 cc9 collisionMinGapFactor "
        # Of changing lanes.
        "lcStrategic lcCooperative lcSpeedGain lcKeepRight lcSublane lcOpposite lcPushy lcPushyGap "
        "lcStrategicLookahead lcAssertive lcLookaheadLeft lcSpeedGainRight lcSpeedGainLookahead "
        "lcSpeedGainRemainTime lcSpeedGainUrgency lcCooperativeRoundabout lcCooperativeSpeed "
        "lcCooperativeHelpTime lcCooperativeHelpThreshold lcCooperativeMinSpeed "
        "lcTurnAlignmentDistance lcImpatience lcTimeToImpatience lcAccelLat "
        "lcMaxSpeedLatStanding lcMaxSpeedLatFactor lcMaxDistLatStanding lcOvertakeRight "
        "lcLaneDiscipline lcSigma lcKeepRightAcceptanceTime lcOvertakeDeltaSpeedFactor lcContRight "
        # Of junctions.
        "jmCrossingGap jmDriveAfterYellowTime jmDriveAfterRedTime jmDriveRedSpeed "
        "jmIgnoreKeepClearTime jmIgnoreFoeSpeed jmIgnoreFoeProb jmIgnoreJunctionFoeProb "
        "jmSigmaMinor jmStoplineGap jmStoplineGapMinor jmTimegapMinor jmExtraGap jmAdvance "
        "jmStopSignWait jmAllwayStopWait"
    ),
    "route": _ROUTE,
    "trip": _allowed(_DRIVING, stop=_STOP),
    "vehicle": _allowed(_DRIVING, route=_ROUTE, stop=_STOP),
    "flow": _allowed(f"{_DRIVING} {_TIMES_OF_FLOWS}", route=_ROUTE, stop=_STOP),
    "person": _allowed(_WALKING, walk=_WALK, personTrip=_PERSON_TRIP, stop=_STOP),
    "personFlow": _allowed(
        f"{_WALKING} {_TIMES_OF_FLOWS}", walk=_WALK, personTrip=_PERSON_TRIP, stop=_STOP
    ),
}
"""Elements of a demand, by name."""

_STOP_OFFSET = _allowed("value vClasses exceptions")
_LANE = _allowed(
    "id index allow disallow prefer speed friction length endOffset width acceleration shape "
    "customShape outlineShape type changeLeft changeRight",
    neigh=_allowed("lane"),
    stopOffset=_STOP_OFFSET,
)
_EXPRESSION = _allowed("id value")

NETWORK = _allowed(
    "version junctionCornerDetail junctionLinkDetail lefthand rectangularLaneCut walkingareas "
    "limitTurnSpeed checkLaneFoesAll checkLaneFoesRoundabout tlsIgnoreInternalJunctionJam "
    "spreadType avoidOverlap junctionHigherSpeed internalJunctionsVehicleWidth "
    "junctionsMinimalShape junctionsEndpointShape",
    location=_allowed("netOffset convBoundary origBoundary projParameter"),
    type=_allowed(
        "id priority numLanes speed allow disallow oneway width sidewalkWidth bikeLaneWidth",
        restriction=_allowed("vClass speed"),
        stopOffset=_STOP_OFFSET,
    ),
    edge=_allowed(
        "id function from to name priority length bidi type routingType shape distance spreadType "
        "crossingEdges",
        lane=_LANE,
        stopOffset=_STOP_OFFSET,
    ),
    tlLogic=_allowed(
        "id type programID offset",
        phase=_allowed(
            "duration state minDur maxDur earliestEnd latestEnd earlyTarget finalTarget yellow red "
            "vehext next name"
        ),
        condition=_EXPRESSION,
        assignment=_allowed("id check value"),
        function=_allowed("id nArgs", assignment=_allowed("id check value")),
    ),
    junction=_allowed(
        "id x y z type incLanes intLanes shape name radius customShape rightOfWay fringe",
        request=_allowed("index response foes cont"),
    ),
    connection=_allowed(
        "from to fromLane toLane pass keepClear contPos visibility allow disallow speed length "
        "shape uncontrolled via tl linkIndex linkIndex2 changeLeft changeRight indirect type dir "
        "state",
        conflict=_allowed("from to fromLane toLane startPos endPos"),
    ),
    prohibition=_allowed("prohibitor prohibited"),
    roundabout=_allowed("nodes edges"),
)
"""Root of a network."""


def copy_allowed(element: Element, allowed: Allowed, left_out: Counter[str]) -> Element:
    """Copy the listed attributes and children of an element; its text has no meaning for SUMO.

    Args:
        element: Element of a user's file.
        allowed: What of it may reach SUMO.
        left_out: Counts of what is left out, by name, which grow.

    Returns:
        A new element that shares nothing with the user's.
    """
    attributes = {}
    for name, value in element.attrib.items():
        if name in allowed.attributes:
            attributes[name] = value
        elif not name.startswith("{"):  # of another namespace, as xsi:noNamespaceSchemaLocation
            left_out[f"{name} of <{one_line(element.tag, 40)}>"] += 1
    copy = Element(element.tag, attributes)
    for child in element:
        inner = allowed.children.get(child.tag)
        if inner is not None:
            copy.append(copy_allowed(child, inner, left_out))
        else:
            key = child.get("key", "")
            left_out[f"<{one_line(child.tag, 40)}{key and ' ' + one_line(key, 40)}>"] += 1
    return copy
