"""An example of a policy in a process of its own; Python's standard library, and no other, runs it.

It drives the intersection by rule: go on, unless a vehicle that is not the ego is close to it.
Any language will do that reads a line, writes a line and knows JSON; see docs/policies.md.

    socialiq's side of it: load("process:python3 process_policy.py", n_features=70, n_actions=3)
"""

import json
import math
import sys

ROW = 7  # presence, x, y, vx, vy, cos h, sin h of a vehicle; the ego's row is the first
SLOWER, FASTER = 0, 2
CLOSE = 0.15  # 15 m, in the observation's unit of 100 m


def decide(observation: list) -> int:
    """The action for one observation."""
    x, y = observation[1:3]
    for start in range(ROW, len(observation), ROW):
        presence, other_x, other_y = observation[start : start + 3]
        if presence and math.hypot(other_x - x, other_y - y) < CLOSE:
            return SLOWER
    return FASTER


def main() -> None:
    """Answer the greeting, then every request, until standard input ends."""
    for line in sys.stdin:
        message = json.loads(line)
        if "protocol" in message:
            answer = {**message, "name": "keeps 15 m", "features": 10 * ROW, "actions": 3}
        else:
            actions = [decide(observation) for observation in message["observations"]]
            answer = {"id": message["id"], "actions": actions}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
