"""Makes the two scenarios beside this file: a crossing of our own in CommonRoad 2020a and 2018b.

A car comes from the west and has priority. One from the south slows down, waits at the stop line
and goes on behind it. A cyclist comes towards the first;
the older version has a pedestrian, who is a circle.

    python examples/recordings/make.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from socialiq_recordings.export import write_commonroad
from socialiq_recordings.recording import Recording, RoadUser, Tracks
from socialiq_recordings.road.network import Lanelet, RoadNetwork, Sign

HERE = Path(__file__).parent
DT, FRAMES = 0.2, 40


def lane(identity: int, start: tuple[float, float], end: tuple[float, float], **more) -> Lanelet:
    """A straight lane of 3.5 m, driven from start to end."""
    ends = np.array([start, end])
    along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
    left = np.array([-along[1], along[0]]) * 1.75
    return Lanelet(identity, ends + left, ends - left, **more)


def road() -> RoadNetwork:
    """West to east with priority, east to west beside it, south to north with a stop line."""
    line = np.array([[-1.75, -6.0], [1.75, -6.0]])
    lanes = [
        lane(
            1,
            (-40, 0),
            (-6, 0),
            successors=(2,),
            sign=Sign.PRIORITY,
            adjacent_left=(9, False),
            speed_limit=13.9,
        ),
        lane(2, (-6, 0), (6, 0), predecessors=(1,), successors=(3,)),
        lane(3, (6, 0), (40, 0), predecessors=(2,)),
        lane(
            4,
            (0, -40),
            (0, -6),
            successors=(5,),
            sign=Sign.YIELD,
            stop_line=line,
            speed_limit=8.3,
        ),
        lane(5, (0, -6), (0, 9.5), predecessors=(4,), successors=(6,)),
        lane(6, (0, 9.5), (0, 40), predecessors=(5,)),
        lane(7, (40, 3.5), (6, 3.5), successors=(8,)),
        lane(8, (6, 3.5), (-6, 3.5), predecessors=(7,), successors=(9,)),
        lane(9, (-6, 3.5), (-40, 3.5), predecessors=(8,), adjacent_left=(1, False)),
    ]
    return RoadNetwork({one.identity: one for one in lanes})


def speeds() -> np.ndarray:
    """By road user and frame, m/s: steady, slowing down and going on, steady."""
    time = np.arange(FRAMES) * DT
    waits = np.interp(time, [0, 1, 4.2, 5.2, 7.8], [8.0, 8.0, 0.0, 0.0, 5.2])
    return np.stack([np.full(FRAMES, 9.0), waits, np.full(FRAMES, 4.0)])


def tracks() -> Tracks:
    """Three road users, positions by the trapezoid rule from their speeds."""
    speed = speeds()
    made = np.cumsum((speed[:, 1:] + speed[:, :-1]) / 2 * DT, axis=1)
    made = np.concatenate([np.zeros((3, 1)), made], axis=1)
    start = np.array([[-32.0, 0.0], [0.0, -30.5], [20.0, 3.5]])
    heading = np.repeat([0.0, 1.5708, 3.1415], FRAMES)
    east, north = np.cos(heading), np.sin(heading)
    track = np.repeat(np.arange(3, dtype=np.int32), FRAMES)
    return Tracks(
        track=track,
        frame=np.tile(np.arange(FRAMES, dtype=np.int32), 3),
        x=(start[track, 0] + made.ravel() * east).round(4),
        y=(start[track, 1] + made.ravel() * north).round(4),
        heading=heading,
        vx=speed.ravel().round(4) * east,
        vy=speed.ravel().round(4) * north,
        identity=np.array([101, 102, 103]),
        road_user=np.array([RoadUser.CAR, RoadUser.CAR, RoadUser.BICYCLE], np.int8),
        length=np.array([4.5, 4.2, 1.8]),
        width=np.array([1.8, 1.7, 0.6]),
        dt=DT,
        recording="ZAM_Crossing-1_1_T-1",
        source={"made_by": "socialiq"},
    )


def older(newer: str) -> str:
    """The same in the words of 2018b: roles, speed limits of lanelets, and more kinds of values."""
    lines = []
    walker = newer.replace("2020a", "2018b").replace("Crossing-1", "Crossing-2")
    tags = walker[walker.index(" <scenarioTags>") : walker.index("</scenarioTags>") + 16]
    walker = walker.replace(tags, "").replace('date="', 'tags="intersection urban" date="')
    signs = walker.index(" <trafficSign ")
    walker = walker[:signs] + walker[walker.index(" <dynamicObstacle") :]
    walker = walker.replace("dynamicObstacle", "obstacle").replace("bicycle", "pedestrian")
    for line in walker.splitlines():
        if "trafficSignRef" in line or "laneletType" in line:
            continue
        if "<type>" in line:
            lines.append("  <role>dynamic</role>")
        if "</lanelet>" in line:
            lines.append("  <speedLimit>13.9</speedLimit>")
        lines.append(line)
    text = "\n".join(lines) + "\n"
    last = text.rindex("<rectangle>")
    end = text.index("</rectangle>", last)
    circle = "<circle>\n    <radius>0.3</radius>\n   </circle>"
    text = text[:last] + circle + text[end + len("</rectangle>") :]
    problem = """ <planningProblem id="900">
  <initialState>
   <position><point><x>0.0</x><y>-38.0</y></point></position>
   <orientation><exact>1.5708</exact></orientation>
   <time><exact>0</exact></time>
   <velocity><exact>6.0</exact></velocity>
   <yawRate><exact>0.0</exact></yawRate>
   <slipAngle><exact>0.0</exact></slipAngle>
  </initialState>
  <goalState>
   <position><lanelet ref="6"/></position>
   <time><intervalStart>30</intervalStart><intervalEnd>40</intervalEnd></time>
  </goalState>
 </planningProblem>
</commonRoad>"""
    return text.replace("</commonRoad>", problem)


def main() -> None:
    """Write both files."""
    path = HERE / "ZAM_Crossing-1_1_T-1.xml"
    write_commonroad(Recording(tracks(), road()), path)
    newer = path.read_text(encoding="utf-8")
    (HERE / "ZAM_Crossing-2_1_T-1.xml").write_text(older(newer), encoding="utf-8")


if __name__ == "__main__":
    main()
