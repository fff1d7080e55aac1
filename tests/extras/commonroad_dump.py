"""Run by a Python that has commonroad-io: what it reads of scenarios, as one JSON object."""

import json
import logging
import sys

from commonroad.common.file_reader import CommonRoadFileReader  # type: ignore[import-not-found]


def dumped(path):
    scenario, _ = CommonRoadFileReader(path).open()
    return {
        "dt": scenario.dt,
        "recording": str(scenario.scenario_id),
        "tracks": [_track(one) for one in scenario.dynamic_obstacles],
        "lanelets": [_lanelet(one) for one in scenario.lanelet_network.lanelets],
    }


def _track(obstacle):
    shape, states = obstacle.obstacle_shape, [obstacle.initial_state]
    if obstacle.prediction is not None:
        states += obstacle.prediction.trajectory.state_list
    round_one = hasattr(shape, "radius")
    return {
        "identity": obstacle.obstacle_id,
        "type": obstacle.obstacle_type.value,
        "length": 2 * shape.radius if round_one else shape.length,
        "width": 2 * shape.radius if round_one else shape.width,
        "states": [
            [
                state.time_step,
                *map(float, state.position),
                float(state.orientation),
                float(state.velocity),
                float(getattr(state, "slip_angle", None) or 0.0),
            ]
            for state in states
        ],
    }


def _lanelet(lanelet):
    line = lanelet.stop_line
    return {
        "identity": lanelet.lanelet_id,
        "left": lanelet.left_vertices.tolist(),
        "right": lanelet.right_vertices.tolist(),
        "centre": lanelet.center_vertices.tolist(),
        "successors": lanelet.successor,
        "predecessors": lanelet.predecessor,
        "adjacent_left": [lanelet.adj_left, lanelet.adj_left_same_direction],
        "adjacent_right": [lanelet.adj_right, lanelet.adj_right_same_direction],
        "stop_line": None if line is None else [line.start.tolist(), line.end.tolist()],
    }


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    json.dump({path: dumped(path) for path in sys.argv[1:]}, sys.stdout)
