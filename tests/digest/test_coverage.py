"""Whatever the code lists has an item of the digest, or a reason in a table why it has none."""

from __future__ import annotations

import ast
import dataclasses
import importlib
import pkgutil
import typing
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import pytest
from tests.digest import batches, junctions, rollouts, traces
from tests.digest.digest import read
from tests.digest.items import ITEMS

import socialiq
import socialiq_lab
import socialiq_recordings
from socialiq.cli.commands import COMMANDS
from socialiq.learners.continuous.config import PRESETS as CONTINUOUS_PRESETS
from socialiq.learners.continuous.train import LEARNERS as CONTINUOUS_LEARNERS
from socialiq.learners.dial.config import PRESETS as DIAL_PRESETS
from socialiq.learners.extensions import LEARNERS
from socialiq.learners.iq_learn.config import PRESETS, IQLearnConfig
from socialiq.nn.saved import FORMS
from socialiq.worlds import RECORDED_JUNCTION, SUMO_IDS, catalogue, files
from socialiq.worlds.highway.effects import EffectOptions
from socialiq.worlds.highway.perception import FrontEnd
from socialiq.worlds.highway.shifts import SHIFTS, Shift, shifts_of
from socialiq.worlds.intersection import policies
from socialiq.worlds.intersection.options import POPULATIONS, FleetOptions
from socialiq_lab.registry import STUDIES
from socialiq_recordings.readers import FORMATS

NAMES = {item.name for item in ITEMS}
STORED = read()

ELSEWHERE = {
    "command/collect": "command/collect/crossing7",
    "command/train/iq-learn": "learner/iq_learn",
    "command/train/dial": "learner/dial/online",
    "command/train/offline-dial": "learner/dial/offline-regularised",
    "command/train/improve-dial": "learner/improve-dial",
    "command/train/driver": "learner/driver",
    "command/train/dqn": "learner/dqn",
    "command/train/sac": "learner/continuous/sac",
    "command/train/td3-bc": "learner/continuous/td3-bc",
    "command/train/behaviour-cloning": "learner/behaviour-cloning",
    "command/train/cql": "learner/cql",
    "command/train/own": "learner/own",
    "command/train/practised-dial": "learner/practised-dial",
    "command/audit": "audit/intersection/rule",
    "command/audit/across": "command/audit/verify",
    "command/page": "page/data",
    "command/view": "page/driven",
    "command/profile/new": "command/profile/crossing7",
    "command/reproduce": "study",
    "command/data/from-trajectories": "reader/steps-trajectories-npz",
    "command/data/from-minari": "reader/steps-minari",
    "command/data/import": "reader/commonroad",
    "form/checkpoint": "saved/content",
    "form/recording": "saved/content",
    "form/recorded-world": "saved/recorded-junction",
    "form/episodes": "study/intersection",
    "form/classical": "study/intersection",
    "learner/continuous/iq-learn": "learner/continuous/iq_learn",
    "reader/csv": "reader/columns",
    "world/recorded-world": "world/recorded-junction",
    "world/sumo": "trace/sumo",
    "world/sumo-row": "trace/sumo-row",
}
"""Items by the name that would be theirs, where they have another one."""

EXCEPTIONS = {
    "command/render": "draws pictures, whose scenes have the items sub-steps/...",
    "command/conformance": "compares with highway-env, which is an extra; prints no own numbers",
    "command/audit/nonce": "draws a random number",
    "command/audit/commit": "writes hashes and a date, and no number",
    "command/audit/sign": "writes a signature, and no number",
    "command/data/to-minari": "needs h5py; data/to-arrays writes the same columns",
    "command/demo": "trains, evaluates and draws by what has the items learner/... and command/...",
    "command/claims": "prints committed results, which change with every new one",
    "command/bench": "measures time",
    "command/completion": "prints a script of the parser's library",
    "command/plot/ring": "draws what has the item command/evaluate",
    "command/plot/stops": "draws what has the item study/grid",
    "command/plot/sweep": "draws what has the item study/lambda-sweep",
    "command/worlds": "lists names, keys and defaults, and no result",
    "reader/argoverse": "needs pyarrow and files of a data set that may not be shipped",
    "study/recorded-junction-practice": "has no preset tiny; its training: learner/practised-dial",
}
"""Reasons by the names that have no item."""


def has_item(name: str) -> bool:
    """Whether there is an item of a name, or of one below it, whose hashes are stored."""
    wanted = ELSEWHERE.get(name, name)
    items = [item for item in NAMES if item == wanted or item.startswith(f"{wanted}/")]
    return any(key.startswith(f"{item}/") for item in items for key in STORED)


def worlds() -> Iterator[str]:
    for name in (*catalogue.NAMES, *catalogue.OLD, *SUMO_IDS, *files._loaders()):
        yield f"world/{name}"
    for name in catalogue.ROADS:
        yield f"fleet/{name}"


def shifts() -> Iterator[str]:
    yield from (f"shift/{name}" for name in SHIFTS)


def forms() -> Iterator[str]:
    for module in modules():
        for kind in kinds_in(module):
            yield f"form/{kind}"
    yield from (f"form/{kind}" for kind in FORMS)


def modules() -> Iterator[ModuleType]:
    """Every module whose source writes arrays."""
    for package in (socialiq, socialiq_recordings, socialiq_lab):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            spec = found.module_finder.find_spec(found.name, None)
            path = Path(spec.origin or "") if spec else Path()
            if path.suffix == ".py" and "save_arrays(" in path.read_text():
                yield importlib.import_module(found.name)


def kinds_in(module: ModuleType) -> Iterator[str]:
    """Kinds of the files that a module writes: those of `FORMS` are written in one place."""
    for node in ast.walk(ast.parse(Path(str(module.__file__)).read_text())):
        if not (isinstance(node, ast.Call) and ast.unparse(node.func).endswith("save_arrays")):
            continue
        kind = node.args[1]
        if isinstance(kind, ast.Constant):
            yield str(kind.value)
        elif isinstance(kind, ast.Name):
            yield getattr(module, kind.id)


def learners() -> Iterator[str]:
    yield from (f"learner/{name}" for name in LEARNERS)
    yield from (f"learner/continuous/{name}" for name in CONTINUOUS_LEARNERS)
    yield from (f"learner/iq_learn/preset/{name}" for name in PRESETS)
    yield from (f"learner/dial/{name}" for name in (*DIAL_PRESETS, "intersection"))
    for preset in CONTINUOUS_PRESETS.values():
        yield from (f"learner/continuous/preset/{name}" for name in preset)
    places = {"prior": "online", "target_kind": "returns", "divergence": "divergence"}
    for name, place in places.items():
        default = getattr(IQLearnConfig, name)
        values = {*choices(IQLearnConfig)[name]} - ({default} if name != "prior" else set())
        yield from (f"learner/iq_learn/{place}/{value}" for value in values)


def readers() -> Iterator[str]:
    yield from (f"reader/{name}" for name in FORMATS)
    maps = Path(str(socialiq_recordings.__file__)).parent / "readers" / "column_maps"
    yield from (f"reader/{path.stem}" for path in maps.glob("*.toml"))


def commands() -> Iterator[str]:
    yield from (f"command/{name.replace(' ', '/')}" for name in COMMANDS)


def studies() -> Iterator[str]:
    yield from (f"study/{name}" for name in STUDIES)


AREAS = (worlds, shifts, forms, learners, readers, commands, studies)


@pytest.mark.parametrize("area", AREAS)
def test_everything_has_an_item_or_a_reason(area: Any) -> None:
    names = {*area()}
    assert len(names) > 1
    without = {name for name in names if not has_item(name)}
    assert without == names & EXCEPTIONS.keys()


def test_no_reason_is_left_over() -> None:
    names = {name for area in AREAS for name in area()}
    assert EXCEPTIONS.keys() <= names
    assert ELSEWHERE.keys() <= names


def test_every_item_has_hashes_and_every_hash_an_item() -> None:
    owners = {key: {name for name in NAMES if key.startswith(f"{name}/")} for key in STORED}
    assert [key for key, names in owners.items() if not names] == []
    assert NAMES - {name for names in owners.values() for name in names} == set()


def test_no_name_of_an_item_is_the_begin_of_another() -> None:
    assert len(NAMES) == len(ITEMS)
    assert [(name, long) for name in NAMES for long in NAMES if long.startswith(f"{name}/")] == []


def test_every_environment_is_traced() -> None:
    traced = {identity for identity, _ in (traces.ENVIRONMENTS | traces.SUMO).values()}
    registered = {name for name in gymnasium.registry if name.startswith("socialiq/")}
    assert registered == traced | {RECORDED_JUNCTION}


def test_every_rule_drives() -> None:
    assert {*rollouts.RULES["intersection"]} == {*policies.NAMES}
    assert {*junctions.made_junction().drivers} == {"driver", "go", "wait"}


def test_every_field_of_shifts_and_front_ends_is_changed() -> None:
    changed = {
        name
        for text in batches.SHIFTS.values()
        for shift in shifts_of(text)
        for name in shift.changes
    }
    assert changed == {field.name for field in dataclasses.fields(Shift)}
    fronts = [front for front in map(front_end, batches.FRONT_ENDS.values()) if front is not None]
    fields = dataclasses.fields(FrontEnd)
    defaults = FrontEnd()
    assert {
        field.name
        for front in fronts
        for field in fields
        if getattr(front, field.name) != getattr(defaults, field.name)
    } == {field.name for field in fields}


def front_end(texts: tuple[str, str]) -> FrontEnd | None:
    return batches.world_named("intersection").shifted(*texts).front_end


def choices(kind: type) -> dict[str, tuple[Any, ...]]:
    """Return the values of each option that has a list of names, or is true or false."""
    hints = typing.get_type_hints(kind)
    named = {name: typing.get_args(hint) for name, hint in hints.items()}
    values = {
        name: values
        for name, values in named.items()
        if typing.get_origin(hints[name]) is typing.Literal
    }
    return values | {name: (False, True) for name, hint in hints.items() if hint is bool}


@pytest.mark.parametrize("world", ["crossing5", "crossing7", "intersection", "merge"])
def test_every_name_of_an_option_has_an_item(world: str) -> None:
    options = batches.world_named(world).options
    table = (batches.GRID_OPTIONS | batches.ROAD_OPTIONS)[world]
    check(options, table)


def test_every_name_of_an_option_of_effects_and_fleets_has_an_item() -> None:
    check(EffectOptions(), batches.ROAD_OPTIONS["intersection-caused"])
    own = {"ends", "frame"}
    tables = tuple(more for _, more in batches.FLEETS.values())
    check(FleetOptions(), tables, own)
    populations = {more.get("population") for more in batches.ROAD_OPTIONS["intersection"]}
    assert POPULATIONS.keys() - {"highway_env"} <= populations


def check(options: Any, table: tuple[dict[str, Any], ...], only: set[str] | None = None) -> None:
    """Assert that each other value than the default of each named option is in a table."""
    for name, values in choices(type(options)).items():
        if only is None or name in only:
            others = {*values} - {getattr(options, name)}
            assert others <= {more.get(name) for more in table}, name
