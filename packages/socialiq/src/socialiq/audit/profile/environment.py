"""Gymnasium environments of users as scenarios: description and hashes."""

from __future__ import annotations

import functools
import importlib.metadata
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

from socialiq.errors import UserError
from socialiq.evaluation.simulate import GymSimulator
from socialiq.reading import sha256_of_file
from socialiq.types import ROWS, Json
from socialiq.worlds.catalogue import in_sumo, scene_named
from socialiq.worlds.environment import action_bounds, make_environment, paired, sizes
from socialiq.worlds.gym import RoadEnv
from socialiq.worlds.highway.world import RoadWorld
from socialiq.worlds.world import World
from socialiq.worlds.wrapper import RewardPairWrapper

LARGEST_SEED = 2**31
"""Environments are reset with the seed of an episode modulo this: not all take larger ones."""

_REPEATED = 50  # steps for the check that the seed determines an episode
_OWN = ("gymnasium", "socialiq")


@dataclass(frozen=True)
class Environment(World):
    """A Gymnasium environment with a reward pair, and its name in a declaration.

    It shows policies no time, and its episodes are run one by one.
    """

    name: str  # as for `worlds.environment.make_environment`
    options: Json  # its keyword arguments
    env: gymnasium.Env[Any, Any]

    shows_time: ClassVar[bool] = False
    draws_by_seed: ClassVar[bool] = True

    @staticmethod
    def of(name: str, options: Json, allow_code: bool, needs_pair: bool = True) -> Environment:
        """Make the environment, as `make_environment` does.

        Args:
            name: Name as for `make_environment`.
            options: Keyword arguments of the environment.
            allow_code: Whether the environment's module may be imported.
            needs_pair: Whether it must give a pair; else a scalar reward is r_env.

        Raises:
            UserError: If the environment can't be made.
        """
        how = {"allow_code": allow_code, "needs_pair": needs_pair, "continuous": True}
        return Environment(name, options, make_environment(name, options, **how))

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return sizes(self.env)[0]

    @property
    def schema(self) -> str:
        """Name and version of the schema of observations, of a road of this package or in SUMO."""
        env = self.env.unwrapped
        return getattr(env, "schema", env.world.schema if isinstance(env, RoadEnv) else ROWS)

    def showing(self, schema: str) -> Environment:
        """Return the same environment with observations of a schema, `rows` or `route`.

        Args:
            schema: Name of the schema.

        Raises:
            UserError: If the environment is of other code.
        """
        if schema != self.schema.rpartition("-")[0]:
            if not (scene_named(self.name) or in_sumo(self.name)):
                raise UserError(f"{self.name} has no routes: name a policy of its observations")
            return Environment.of(self.name, {**self.options, "observation": schema}, False)
        return self

    @property
    def action_space(self) -> gymnasium.Space[Any]:
        """Space of one action: numbers from 0, or vectors in [-1, 1]."""
        return self.env.action_space

    def batch(self, size: int, threads: int = 1) -> GymSimulator:  # noqa: ARG002  there is one
        """Return the environment as a simulator of one episode at a time.

        Args:
            size: Number of episodes that are asked for; it has no effect.
            threads: Number of threads; it has no effect.
        """
        return GymSimulator(self.env, modulus=LARGEST_SEED)

    @property
    def scene_world(self) -> RoadWorld | None:
        """The compiled road of a scene of highway-env; None for environments of other code."""
        env = self.env.unwrapped
        return env.world if scene_named(self.name) and isinstance(env, RoadEnv) else None

    @functools.cached_property
    def description(  # pyright: ignore[reportIncompatibleMethodOverride]  made once
        self,
    ) -> str:
        """Name, options, spaces, time limit, sources and versions as JSON with sorted keys.

        Of continuous actions the bounds are included, in the environment's units. The sources are
        those of the files that define the environment's class, its wrappers, its registered entry
        point or the named function, and the functions of the pair; of the files that they import,
        only the versions of installed packages are included. An environment with `files`, as one in
        SUMO, is described by these hashes too.
        """
        spec = self.env.spec
        module = self.name.rpartition(":")[0]
        # The file of the module in the name.
        file = getattr(sys.modules.get(module), "__file__", None)
        file = module if module.endswith(".py") else file
        own_file = {module: sha256_of_file(Path(file))} if file else {}
        kwargs = "{}"
        if spec is not None:  # values without a JSON form become their type's name
            kwargs = json.dumps(dict(spec.kwargs), default=lambda value: type(value).__name__)
        described = {
            "name": self.name,
            "options": dict(self.options),
            "n_features": self.n_features,
            **(action_bounds(self.env) or {"n_actions": sizes(self.env)[1]}),
            "max_episode_steps": None if spec is None else spec.max_episode_steps,
            "kwargs": json.loads(kwargs),
            "sources": _sources(self._parts()) | own_file,
            "versions": _versions(self._parts()),
            **({"files": files} if (files := getattr(self.env.unwrapped, "files", None)) else {}),
        }
        return json.dumps(described, sort_keys=True, separators=(",", ":"))

    @property
    def reward(self) -> dict[str, Any]:
        """Definition of the pair: sources and versions of the code that gives it."""
        giver = paired(self.env)
        objects = [type(self.env.unwrapped)] if giver is None else [giver.pair]
        return {"sources": _sources(objects), "versions": _versions(objects)}

    @property
    def reward_id(self) -> str:
        """Name of the reward pair, which the environment's sources define."""
        return f"environment/{self.name}"

    def _parts(self) -> list[Any]:
        """Return the classes and functions whose code is hashed."""
        objects: list[Any] = [type(self.env.unwrapped)]
        env = self.env
        while isinstance(env, gymnasium.Wrapper):
            objects.append(type(env))
            if isinstance(env, RewardPairWrapper):
                objects += [function for function in (env.pair, env.ending) if function is not None]
            env = env.env
        return objects

    def check_repeats(self, seed: int) -> None:
        """Check that a seed determines its episode, which is started twice.

        At every step the action is the first, or the middle of a box.

        Raises:
            UserError: If observations, rewards or endings differ.
        """
        space = self.action_space
        traces = []
        action = np.zeros(space.shape, np.float32) if isinstance(space, spaces.Box) else 0
        for _ in range(2):
            observation, _ = self.env.reset(seed=seed % LARGEST_SEED)
            trace: list[Any] = [observation.tobytes()]
            for _ in range(_REPEATED):
                observation, _, terminated, truncated, info = self.env.step(action)
                pair = tuple(info["reward_pair"])
                trace.append((observation.tobytes(), pair, terminated, truncated))
                if terminated or truncated:
                    break
            traces.append(trace)
        if traces[0] != traces[1]:
            raise UserError(
                f"an episode of {self.name} is not determined by its seed: draw every random "
                "number from self.np_random, which reset(seed=...) seeds"
            )


def _module_of(defined: Any) -> str:
    """Return the name of the module of a class, a function or a callable object."""
    return getattr(defined, "__module__", None) or type(defined).__module__


def _foreign(objects: list[Any]) -> list[Any]:
    """Return the parts that are neither of Gymnasium nor of this package."""
    partial = functools.partial
    bare = (code.func if isinstance(code, partial) else code for code in objects)
    return [defined for defined in bare if _module_of(defined).split(".")[0] not in _OWN]


def _sources(objects: list[Any]) -> dict[str, str]:
    """Return the SHA-256 of the file of each part's code, by module."""
    files = {}
    for defined in _foreign(objects):
        # A module's name could belong to another file.
        kind = defined if isinstance(defined, type) else type(defined)
        members = (defined, *vars(kind).values())
        codes = (getattr(member, "__code__", None) for member in members)
        file = next((code.co_filename for code in codes if code is not None), "")
        files[_module_of(defined)] = Path(file)
    return {name: sha256_of_file(path) for name, path in sorted(files.items()) if path.is_file()}


_owners = functools.cache(importlib.metadata.packages_distributions)  # it reads all: half a second


def _versions(objects: list[Any]) -> dict[str, str]:
    """Return the versions of Gymnasium and of the installed packages of these modules."""
    owners = _owners()
    tops = {_module_of(defined).split(".")[0] for defined in _foreign(objects)}
    names = {"gymnasium", *(owner for top in tops for owner in owners.get(top, ()))}
    return {name: importlib.metadata.version(name) for name in sorted(names)}
