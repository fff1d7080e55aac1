"""One episode in SUMO, driven decision by decision beside the same episode without the ego.

libsumo holds one simulation in a process. An episode is its seed and the actions taken, so one that
finds another in its place is played again from the start, with the same bits.
"""

from __future__ import annotations

import contextlib
import io
import math
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from socialiq.errors import UserError
from socialiq.foreign import one_line, optional
from socialiq.types import Ending
from socialiq.worlds.highway.core.effects import HARD, encounter
from socialiq.worlds.highway.core.rewards import observe
from socialiq.worlds.highway.core.vehicle import SPEED_GAIN
from socialiq.worlds.highway.options import FEATURES, Contact
from socialiq.worlds.intersection.options import FASTER, IDLE, SIGHT
from socialiq.worlds.sumo.network import CLASSES, VEHICLE, WALKING
from socialiq.worlds.sumo.traffic import EGO, Scene

STEPS = 10  # of SUMO in a decision of 1 s
_STANDS = 0.1  # m/s below which a road user waits, as SUMO counts waiting time
SETTINGS = (
    "--step-length", "0.1", "--no-step-log", "--no-warnings", "--seed", "1",
    "--collision.action", "warn", "--collision.check-junctions", "--collision.mingap-factor", "0",
    "--time-to-teleport", "-1", "--pedestrian.striping.dawdling", "0", "--ignore-route-errors",
    "--eager-insert", "--xml-validation", "never", "--xml-validation.net", "never",
)  # fmt: skip
"""Settings of SUMO: nothing random, nothing teleported, contacts reported, the ego enters at
its time though others wait to enter on its edge, and no schema is fetched or read."""

_CLEARED = 20.0  # m around the ego's entry
_FRONT = 2.5  # m from the middle of a vehicle to its front
_STRIP = 1.5  # m to either side of the ego's middle in which a person is in its way
_ARRIVED_AT = 25.0  # m along the ego's last edge
_OWN_SPEED = 0  # speed mode without any check of SUMO
_SUMOS_SPEED = 31  # speed mode with all checks of SUMO
_NUMBERS = {kind: number for number, kind in enumerate(CLASSES)}
_holder: list[Any] = []  # the episode that the process' simulation is at


class Body(NamedTuple):
    """Road user as the kernels read it: centre m, heading rad clockwise from east, speed m/s."""

    x: float
    y: float
    heading: float
    speed: float
    along_x: float
    along_y: float
    name: str


class Frame(NamedTuple):
    """Frame in which the ego sees the road: a junction's middle, to which it comes from the south.

    Where traffic keeps to the left the frame is mirrored in the ego's approach, so policies observe
    right-hand traffic, which they were trained in.
    """

    x: float  # middle of the junction in SUMO, m
    y: float
    north_x: float  # direction of the ego's approach there
    north_y: float
    east: float  # 1, or -1 where it is mirrored

    def turned(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Return a vector of SUMO in the frame, to the east and to the south.

        Args:
            x: Its part to SUMO's east, a number or an array.
            y: Its part to SUMO's north.
        """
        east = self.east * (x * self.north_y - y * self.north_x)
        return east, -(x * self.north_x + y * self.north_y)


class EgoState(NamedTuple):
    """Facts that the ego knows of itself."""

    junction: int  # number on its way of the junction that it is in or comes to
    frame: Frame
    target_speed: float  # m/s


class Moved(NamedTuple):
    """Motion of others in a decision, by name."""

    metres: Counter[str]  # of floats
    hardest: dict[str, float]  # least acceleration, m/s²
    waited: Counter[str]  # of seconds
    arrived: set[str]

    @staticmethod
    def none() -> Moved:
        """Return a motion without road users."""
        return Moved(Counter(), {}, Counter(), set())

    def by_class(self) -> Float[np.ndarray, "class 3"]:
        """Return metres, hard brakings and seconds waited by class; walkers don't brake."""
        sums = np.zeros((len(CLASSES), 3))
        for name, metres in self.metres.items():
            kind = class_of(name)
            brakes = kind not in WALKING and self.hardest[name] < HARD
            sums[_NUMBERS[kind]] += metres, brakes, self.waited[name]
        return sums


class Result(NamedTuple):
    """Outcome of a decision."""

    ending: Ending
    contact: Contact
    partner: str  # class of who collided with the ego, or ""
    advance: float  # m along the ego's way
    speed: float  # m/s
    # metres lost, hard brakings, and seconds waited; all later ones at an end
    caused: Float[np.ndarray, "class 3"]
    encounter: Float[np.ndarray, " class"]  # closest of each class, 0 to 1


def class_of(name: str) -> str:
    """Return the class of a road user, with which its name begins."""
    return name.rstrip("0123456789.")


def gap_ahead(ego: Body, person: Body, seconds: float) -> float:
    """Return the metres from the ego's front to a person in its way, infinite if there is none.

    A person beside the way, straight on along the ego's heading, counts where its own velocity
    leads it in.

    Args:
        ego: The ego.
        person: The person, on foot or on a bicycle.
        seconds: Time within which the person has to get into the way, s.
    """
    dx = person.x - ego.x
    dy = person.y - ego.y
    ahead = dx * ego.along_x + dy * ego.along_y
    left = dy * ego.along_x - dx * ego.along_y
    across = person.along_y * ego.along_x - person.along_x * ego.along_y
    along = person.along_x * ego.along_x + person.along_y * ego.along_y
    beside = abs(left) - _STRIP
    closing = -math.copysign(1.0, left) * across * person.speed
    if beside > 0.0:
        if beside > seconds * closing:
            return math.inf
        ahead += beside / closing * along * person.speed
    return ahead - _FRONT if ahead > 0.0 else math.inf


def arrival_on(length: float) -> float:
    """Return where the middle of the ego arrives on its last edge, m.

    Args:
        length: Length of the edge, m.
    """
    return min(_ARRIVED_AT, length / 2)


def library() -> Any:
    """Return libsumo, which the extra `sumo` installs."""
    # It prints advice about pyarrow on standard output, which belongs to --json.
    with contextlib.redirect_stdout(io.StringIO()):
        return optional("libsumo", "sumo", "worlds in SUMO")


class Episode:
    """Episode in SUMO.

    Attributes:
        without: What others drive without the ego to the common end, m by name.
        driven: What they drive with it, so far.

    Raises:
        UserError: If libsumo is missing, or SUMO refuses the network.
    """

    def __init__(self, scene: Scene, seed: int) -> None:
        self.scene = scene
        self.seed = seed
        self.sumo = library()
        options = scene.options
        self.horizon = options.decisions(options.road)
        self.actions = list[int]()
        self._begin(with_ego=False)
        seconds = [self._second()[0] for _ in range(self.horizon)]
        self.alone = [second.by_class() for second in seconds]
        self.without = Counter()
        for second in seconds:
            self.without.update(second.metres)
        self.left = set().union(*(second.arrived for second in seconds))
        self._begin(with_ego=True)

    def _begin(self, with_ego: bool) -> None:
        """Play the traffic until the ego is there, or would be; its place is cleared."""
        options = self.scene.options
        sumo = self.sumo
        _holder[:] = [self]
        with tempfile.TemporaryDirectory() as folder:
            network = Path(folder) / "network.net.xml"
            routes = Path(folder) / "routes.rou.xml"
            network.write_text(self.scene.network.xml)
            routes.write_text(self.scene.demand(self.seed, with_ego))
            settings = ["-n", str(network), "-r", str(routes), *SETTINGS]
            settings += ["--begin", str(self.scene.begin(self.seed))]
            try:
                if sumo.isLoaded():
                    sumo.load(settings)
                else:
                    sumo.start(["sumo", *settings])
                for _ in range(round(options.warm_up * STEPS)):
                    sumo.simulationStep()
            except Exception as error:
                raise UserError(
                    f"SUMO refuses {self.scene.network.file}: {one_line(str(error))}"
                ) from error
        edge = self.scene.way[0]
        for name in sumo.edge.getLastStepVehicleIDs(edge):
            ahead = sumo.vehicle.getLanePosition(name) - self.scene.front(self.seed)
            if abs(ahead) < _CLEARED and name != EGO:
                sumo.vehicle.remove(name)
        self._speeds = dict[str, float]()
        self._wrecks = dict[str, float]()
        self.driven = Counter()
        self._target = 0.0
        self._advance = 0.0
        self._partner = ""
        self._step(Moved.none())
        if with_ego:
            if EGO not in self._speeds:
                raise UserError(f"SUMO lets no ego in on {edge}: choose another start")
            sumo.vehicle.setSpeedMode(EGO, _OWN_SPEED)
            self._target = self.scene.options.road.max_speed
            self.bodies = self._bodies()

    def step(self, action: int) -> Result:
        """Take a decision: 0 slower, 1 idle, 2 faster."""
        if _holder[0] is not self:
            taken = self.actions
            self.actions = []
            self._begin(with_ego=True)
            for earlier in taken:
                self.step(earlier)
        if action != IDLE:
            self._target = self._next_speed(1 if action == FASTER else -1)
        moved, closest, contact = self._second(driving=True)
        self.actions.append(action)
        now = len(self.actions)
        before = self._advance
        if EGO in self._speeds:
            self._advance = self.sumo.vehicle.getDistance(EGO)
        ending = self._ending(contact)
        self.bodies = self._bodies()
        speed = self.bodies[0].speed
        caused = self._caused(now - 1, moved)
        if ending != Ending.NONE:
            self._leave(ending)
            for later in range(now, self.horizon):
                caused = caused + self._caused(later, self._second()[0])
                self._tow(later)
        advance = self._advance - before
        return Result(ending, contact, self._partner, advance, speed, caused, closest)

    def _next_speed(self, change: int) -> float:
        """Return the target speed so many steps from the one nearest to the present speed."""
        speeds = self.scene.options.road.target_speeds
        nearest = round((self.bodies[0].speed - speeds[0]) / (speeds[1] - speeds[0]))
        return speeds[min(max(min(nearest, len(speeds) - 1) + change, 0), len(speeds) - 1)]

    def _second(self, driving: bool = False) -> tuple[Moved, np.ndarray, Contact]:
        """Play a second; return what others did, the closest encounters, and the ego's contact."""
        moved = Moved.none()
        closest = np.zeros(len(CLASSES))
        contact = Contact.NONE
        for _ in range(STEPS):
            if driving and contact == Contact.NONE and EGO in self._speeds:
                speed = self.sumo.vehicle.getSpeed(EGO)
                change = SPEED_GAIN * (self._target - speed) / STEPS
                self.sumo.vehicle.setSpeed(EGO, max(speed + change, 0.0))
            self._step(moved)
            if not driving or EGO not in self._speeds:
                continue
            contact = self._touched() if contact == Contact.NONE else contact
            ego, *bodies = self._bodies()
            for body in bodies:
                kind = _NUMBERS[class_of(body.name)]
                closest[kind] = max(closest[kind], encounter(ego, body))
        return moved, closest, contact

    def _step(self, moved: Moved) -> None:
        """Play a step of SUMO and add what others did in it."""
        sumo = self.sumo
        before = self._speeds
        sumo.simulationStep()
        self._speeds = {name: sumo.vehicle.getSpeed(name) for name in sumo.vehicle.getIDList()}
        self._speeds |= {name: sumo.person.getSpeed(name) for name in sumo.person.getIDList()}
        for name, speed in self._speeds.items():
            if name != EGO:
                moved.metres[name] += speed / STEPS
                moved.waited[name] += (speed < _STANDS) / STEPS
                rate = (speed - before.get(name, speed)) * STEPS
                hardest = moved.hardest.get(name, 0.0)
                moved.hardest[name] = hardest if name in self._wrecks else min(hardest, rate)
        moved.arrived.update(before.keys() - self._speeds.keys() - self._wrecks.keys())

    def _caused(self, number: int, moved: Moved) -> Float[np.ndarray, "class 3"]:
        """Return what a decision causes, as in `Result`, and note what others drove."""
        for name in moved.arrived & self.left:  # who leaves in both worlds drove as far
            moved.metres[name] = self.without[name] - self.driven[name]
            moved.hardest.setdefault(name, 0.0)
        self.driven.update(moved.metres)
        return (moved.by_class() - self.alone[number]) * (-1.0, 1.0, 1.0)

    def _touched(self) -> Contact:
        """Return the ego's contact in the last step; both stop where they are, as wrecks."""
        for collision in self.sumo.simulation.getCollisions():
            names = {collision.collider, collision.victim}
            if EGO in names:
                for name in names & set(self.sumo.vehicle.getIDList()):
                    self.sumo.vehicle.setSpeedMode(name, _OWN_SPEED)
                    self.sumo.vehicle.setSpeed(name, 0.0)
                    self._wrecks[name] = len(self.actions) + self.scene.options.tow_after
                self._partner = "".join(map(class_of, names - {EGO}))
                struck = collision.collider == EGO
                return Contact.EGO_STRUCK if struck else Contact.EGO_WAS_STRUCK
        return Contact.NONE

    def _ending(self, contact: Contact) -> Ending:
        if contact != Contact.NONE:
            return Ending.COLLISION
        way = self.scene.way
        last = self.scene.network.edges[self.scene.way[-1]]
        if EGO not in self._speeds:
            return Ending.ARRIVAL
        on_last = self.sumo.vehicle.getRoadID(EGO) == way[-1]
        goal = arrival_on(last.length)
        if on_last and self.sumo.vehicle.getLanePosition(EGO) - 2.5 >= goal:
            return Ending.ARRIVAL
        out = len(self.actions) >= self.scene.options.road.decisions
        return Ending.TIMEOUT if out else Ending.NONE

    def _leave(self, ending: Ending) -> None:
        """Take the ego out of the traffic, or leave it there as a wreck or as a driver of SUMO."""
        if EGO not in self._speeds or ending == Ending.COLLISION:
            return
        if ending == Ending.TIMEOUT and self.scene.options.after_timeout == "traffic":
            self.sumo.vehicle.setSpeedMode(EGO, _SUMOS_SPEED)
            self.sumo.vehicle.setSpeed(EGO, -1.0)
        else:
            self.sumo.vehicle.remove(EGO)

    def _tow(self, now: int) -> None:
        for name, due in self._wrecks.items():
            if self.scene.options.tow_after and now >= due and name in self._speeds:
                self.sumo.vehicle.remove(name)

    @property
    def ego_state(self) -> EgoState:
        """Facts that the ego knows of itself."""
        return EgoState(self._junction, self._frame, self._target)

    def _frame_now(self) -> Frame:
        """Return the frame of the junction that the ego is in or comes to."""
        network = self.scene.network
        way = self.scene.way
        self._junction = max(min(self.sumo.vehicle.getRouteIndex(EGO), len(way) - 2), 0)
        edge = network.edges[way[self._junction]]
        begin, end = edge.tail
        centre = network.junctions[edge.end][1] if edge.end in network.junctions else end
        x, y = centre.tolist()
        north_x, north_y = ((end - begin) / np.hypot(*(end - begin))).tolist()
        return Frame(x, y, north_x, north_y, network.right)

    def _bodies(self) -> list[Body]:
        """Return the ego, then vehicles and who rides, then who walks, as the ego sees the road."""
        if EGO not in self._speeds:
            return self.bodies
        frame = self._frame = self._frame_now()

        def body(domain: Any, name: str, behind: float) -> Body:
            angle = math.radians(domain.getAngle(name))  # clockwise from SUMO's north
            hx = math.sin(angle)
            hy = math.cos(angle)
            x, y = domain.getPosition(name)
            place = frame.turned(x - frame.x - behind * hx, y - frame.y - behind * hy)
            along = frame.turned(hx, hy)
            heading = math.atan2(along[1], along[0])
            return Body(*place, heading, self._speeds[name], *along, name)

        vehicles = [name for name in self.sumo.vehicle.getIDList() if name != EGO]
        cars = [
            body(self.sumo.vehicle, name, CLASSES.get(class_of(name), VEHICLE).length / 2)
            for name in (EGO, *vehicles)
        ]
        return cars + [body(self.sumo.person, n, 0.0) for n in self.sumo.person.getIDList()]

    @property
    def observation(self) -> Float32[np.ndarray, " feature"]:
        """Rows of the ego, and of vehicles and who rides near it, as at the intersection."""
        rows = np.zeros((self.scene.options.road.observed_vehicles, len(FEATURES)), np.float32)
        visible = [body for body in self.bodies if class_of(body.name) not in WALKING]
        ego = visible[0]
        along = [body.x * ego.along_x + body.y * ego.along_y for body in visible]
        view = along, 0.0, SIGHT.view(np.recarray)[0], (1.0, 0.0), (len(rows), False)
        observe(visible, len(visible), 0, view, rows)
        return rows.ravel()
