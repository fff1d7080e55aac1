"""Demonstrations as columns: the extended tuples of thesis 5.2, one row per transition.

The two rewards are kept separate, as in the thesis, so that one recording serves every social
angle. The cumulative returns G_env and G_social of its tuple are not stored but derived
(`Demonstrations.returns`), because the thesis leaves open what "cumulative" means (5.3.1).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Bool, Float32, Int, Int8, Int32, Shaped

from socialiq.demonstrations import columns
from socialiq.errors import UserError, one_of
from socialiq.social.returns import TARGET_KINDS, advantage, cumulative, mean_by_state
from socialiq.types import OBSERVATION, ROWS, Ending, RewardPair

ADVANTAGE_KINDS = ("advantage", "advantage_fitted")
"""Targets that are the rewards, shaped by the demonstrators' mean return-to-go V of a state.

`advantage` takes the mean over the rows with the same observation, which is exact in worlds with a
table of states. `advantage_fitted` fits a small network, for observations that never repeat; each
row's V comes from a network that has not seen its episode, because a V that was fitted to a row's
own return would cancel it."""


# Compared by identity: the generated comparison of arrays would raise. Two tables hold the same
# content if `files.save` returns the same hash for both.
@dataclass(frozen=True, eq=False, repr=False)
class Demonstrations:
    """A checked table of transitions, the rows of each episode adjacent and in order.

    An episode need not be whole: after `subsample` its rows skip steps, so a row's
    `next_observation` need not be the next row's `observation`, and the last row need not end
    the episode; sums over it are then refused. Nothing follows an end inside an episode.

    Raises:
        UserError: If a column breaks any of this; the line names it and its first bad row.
    """

    observation: Float32[np.ndarray, "transition feature"]  # s
    # Discrete: int32 in [0, n_actions); continuous: float32 rows in [-1, 1], the world's bounds.
    action: Shaped[np.ndarray, "transition ..."]
    next_observation: Float32[np.ndarray, "transition feature"]  # s'
    terminated: Bool[np.ndarray, " transition"]  # s' is a terminal state
    truncated: Bool[np.ndarray, " transition"]  # the world's clock cut the episode at s'
    ending: Int8[np.ndarray, " transition"]  # `types.Ending`: TIMEOUT if truncated only, or NONE
    rewards: RewardPair  # float64
    mode: Int8[np.ndarray, " transition"]  # of the demonstrator, in `mode_names`; one per episode
    episode: Int32[np.ndarray, " transition"]  # from 0 without gaps
    step: Int32[np.ndarray, " transition"]  # from 0; it skips where rows were left out
    mode_names: tuple[str, ...]  # some may be without episodes
    n_actions: int  # of the world; 0 if they are continuous
    source: dict[str, Any]  # provenance (world, options, seeds), as JSON returns it

    # Run-time type checkers leave the constructor to `__post_init__`, whose lines say what to do.
    __no_type_check__: ClassVar[bool] = True

    def __repr__(self) -> str:
        return f"Demonstrations({self.summary()})"

    def __post_init__(self) -> None:
        """Check every column, and detach `source` from the caller's dict."""
        if not isinstance(self.rewards, RewardPair):
            raise UserError("rewards must be a RewardPair of two columns (r_env, r_social)")
        columns.check(self.arrays(), self.n_actions, self.mode_names)
        object.__setattr__(self, "source", columns.json_able(self.source))

    @staticmethod
    def of(
        *,
        observation: Any,
        action: Any,
        next_observation: Any,
        ending: Any,
        rewards: RewardPair,
        episode: Any,
        n_actions: int,
        mode: Any = None,
        mode_names: tuple[str, ...] = ("demonstrator",),
        step: Any = None,
        source: dict[str, Any] | None = None,
    ) -> Demonstrations:
        """Build a table from the columns that cannot be derived, converting their types.

        `terminated` and `truncated` follow from `ending`; an ending that is both (a terminal state
        reached as the clock runs out) needs the constructor.

        The arguments are the class's attributes; `mode` is 0 in every row, and `step` is counted
        within the episode, where they are not given.

        Raises:
            UserError: If a column is wrong; the line names it and its first bad row.
        """
        kinds = np.asarray(ending, np.int8)
        number = np.asarray(episode, np.int32)
        terminated, truncated = columns.flags_of(kinds)
        return Demonstrations(
            observation=np.asarray(observation, np.float32),
            action=np.asarray(action, np.int32 if n_actions else np.float32),
            next_observation=np.asarray(next_observation, np.float32),
            terminated=terminated,
            truncated=truncated,
            ending=kinds,
            rewards=RewardPair(*(np.array(column, np.float64) for column in rewards)),
            mode=np.zeros(len(number), np.int8) if mode is None else np.asarray(mode, np.int8),
            episode=number,
            step=columns.steps_of(number) if step is None else np.asarray(step, np.int32),
            mode_names=mode_names,
            n_actions=n_actions,
            source=source or {},
        )

    @staticmethod
    def of_arrays(
        arrays: dict[str, np.ndarray],
        mode_names: tuple[str, ...],
        n_actions: int,
        source: dict[str, Any],
    ) -> Demonstrations:
        """Build a table from all of its named arrays, the inverse of `arrays()`.

        Args:
            arrays: All columns of `columns.LAYOUT` by name.
            mode_names: Names of the demonstrators.
            n_actions: Number of actions; 0 for continuous ones.
            source: Provenance of the data.

        Raises:
            UserError: If a column is missing, unknown or wrong.
        """
        missing = [name for name in columns.LAYOUT if name not in arrays]
        unknown = [name for name in arrays if name not in columns.LAYOUT]
        if missing or unknown:
            raise UserError(
                f"columns missing: {', '.join(missing) or 'none'}; unknown: "
                f"{', '.join(unknown) or 'none'}: pass exactly {', '.join(columns.LAYOUT)}"
            )
        plain = {name: array for name, array in arrays.items() if not name.startswith("r_")}
        rewards = RewardPair(arrays["r_env"], arrays["r_social"])
        return Demonstrations(
            **plain, rewards=rewards, mode_names=mode_names, n_actions=n_actions, source=source
        )

    def arrays(self) -> dict[str, Any]:
        """Return all columns by name, in a file's order; the rewards as `r_env` and `r_social`."""
        rewards = {"r_env": self.rewards.env, "r_social": self.rewards.social}
        return {
            name: rewards[name] if name in rewards else getattr(self, name)
            for name in columns.LAYOUT
        }

    @property
    def n_transitions(self) -> int:
        """Number of rows."""
        return len(self.action)

    @property
    def n_episodes(self) -> int:
        """Number of episodes."""
        return int(self.episode[-1]) + 1

    @property
    def schema(self) -> str:
        """Schema of the observations, as their source or one that it is made of names it."""
        sources: list[Any] = [self.source]
        while sources:
            source = sources.pop()
            if isinstance(source, list):
                sources += source
            elif isinstance(source, dict):
                if OBSERVATION in source:
                    return str(source[OBSERVATION])
                sources += source.values()
        return ROWS

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.observation.shape[1]

    @property
    def action_size(self) -> int:
        """Length of a continuous action; 0 if actions are discrete."""
        return self.action.shape[1] if self.action.ndim == 2 else 0

    @property
    def episode_starts(self) -> Int[np.ndarray, " episode"]:
        """Row of the first transition of each episode."""
        return np.flatnonzero(np.diff(self.episode, prepend=-1))

    @property
    def episode_lengths(self) -> Int[np.ndarray, " episode"]:
        """Number of rows of each episode."""
        return np.bincount(self.episode)

    @property
    def episode_modes(self) -> Int8[np.ndarray, " episode"]:
        """Mode of each episode, an index into `mode_names`."""
        return self.mode[self.episode_starts]

    def returns(self, kind: str, discount: float) -> RewardPair:
        """Return (G_env, G_social) of every transition, each (transition,), float64 (thesis 5.3.1).

        Args:
            kind: One of `social.returns.TARGET_KINDS`, or of `ADVANTAGE_KINDS`.
            discount: γ_svo of Table C.1.

        Raises:
            UserError: If the kind is unknown, or needs steps, repeated states or episodes that are
                not here.
        """
        one_of("target kind", kind, (*TARGET_KINDS, *ADVANTAGE_KINDS))
        if kind not in ADVANTAGE_KINDS:
            if kind != "instantaneous":
                self._check_whole()
            env, social = (cumulative(kind, r, self.episode, discount) for r in self.rewards)
            return RewardPair(env, social)
        # Cached: a learner needs them twice, and a fit takes long.
        cached = _ADVANTAGES.setdefault(self, {})
        key = kind, discount
        if key not in cached:
            to_go = self.returns("to_go", discount)
            if kind == "advantage_fitted":
                from socialiq.nn import regression  # needs JAX

                returns = np.stack(to_go, axis=1)
                values = regression.cross_fitted(self.observation, returns, self.episode).T
            else:
                values = [mean_by_state(self.observation, returns) for returns in to_go]
            pairs = zip(self.rewards, values, strict=True)
            cached[key] = RewardPair(*(advantage(r, v, self.episode, discount) for r, v in pairs))
        return RewardPair(*(column.copy() for column in cached[key]))

    def totals(self) -> RewardPair:
        """Return undiscounted sums of both rewards over each whole episode, each (episode,)."""
        self._check_whole()
        starts = self.episode_starts
        return RewardPair(*(np.add.reduceat(r, starts) for r in self.rewards))

    def select(self, episodes: Shaped[np.ndarray, " chosen"]) -> Demonstrations:
        """Keep the given episodes, renumbered, in the order given; repeats are allowed.

        `source` stays as it is: the provenance of the episodes.
        """
        if not np.issubdtype(episodes.dtype, np.integer) or len(episodes) == 0:
            raise UserError("select needs the numbers of at least one episode, as integers")
        unknown = (episodes < 0) | (episodes >= self.n_episodes)
        if unknown.any():
            raise UserError(
                f"no episode {episodes[unknown][0]}: select from 0 to {self.n_episodes - 1}"
            )
        lengths = self.episode_lengths[episodes]
        episode = np.repeat(np.arange(len(episodes), dtype=np.int32), lengths)
        within = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        return self._take(self.episode_starts[episodes][episode] + within, episode, self.source)

    def subsample(self, every: int, offset: int = 0) -> Demonstrations:
        """Keep rows offset, offset + every, ... of each episode, as imitation benchmarks do.

        Args:
            every: Distance of the kept rows.
            offset: First kept row of each episode, from 0.

        Raises:
            UserError: If `every` < 1, `offset` < 0, or an episode would lose all its rows.
        """
        if every < 1 or offset < 0:
            raise UserError(f"cannot keep every {every} from {offset}: use every >= 1, offset >= 0")
        shortest = int(self.episode_lengths.min())
        if offset >= shortest:
            raise UserError(
                f"offset {offset} would empty episode {int(self.episode_lengths.argmin())} of "
                f"{shortest} transitions: use an offset below {shortest}"
            )
        within = np.arange(self.n_transitions) - self.episode_starts[self.episode] - offset
        rows = np.flatnonzero((within >= 0) & (within % every == 0))
        source = {"made_by": "subsample", "every": every, "offset": offset, "of": self.source}
        return self._take(rows, self.episode[rows], source)

    def with_clock(self) -> Demonstrations:
        """Return the same transitions with the number of the step as a last feature."""
        time = self.step.astype(np.float32)
        return dataclasses.replace(
            self,
            observation=np.column_stack([self.observation, time]),
            next_observation=np.column_stack([self.next_observation, time + 1.0]),
        )

    def one_of_each_block(self, size: int, seed: int) -> Demonstrations:
        """Keep one random row from each block of rows of an episode.

        Rows at a fixed stride see a periodic demonstrator in few of its phases; random rows see
        all. The row that ends an episode in a terminal state is kept as well, since learners that
        treat endings by how often they occur would else be misled.

        Args:
            size: Rows of a block, at least 1.
            seed: Seed of the draw.

        Raises:
            UserError: If the size is below 1.
        """
        if size < 1:
            raise UserError(f"cannot keep one row of each {size}: use a block of 1 or more rows")
        within = np.arange(self.n_transitions) - self.episode_starts[self.episode]
        block = np.unique(np.stack([self.episode, within // size]), axis=1, return_inverse=True)[1]
        order = np.random.default_rng(seed).permutation(self.n_transitions)
        first = np.unique(block[order], return_index=True)[1]
        rows = np.union1d(order[first], np.flatnonzero(self.terminated))
        source = {"made_by": "one_of_each_block", "size": size, "seed": seed, "of": self.source}
        return self._take(rows, self.episode[rows], source)

    def with_mode_names(self, mode_names: tuple[str, ...]) -> Demonstrations:
        """Return the same rows under another list of names, with each mode that has episodes."""
        lost = [n for n, size in self.counts().items() if size != (0, 0) and n not in mode_names]
        if lost:
            raise UserError(f"mode '{lost[0]}' has episodes: keep it among the mode names")
        places = {name: index for index, name in enumerate(mode_names)}
        index = np.array([places.get(name, -1) for name in self.mode_names], np.int8)
        return dataclasses.replace(self, mode=index[self.mode], mode_names=mode_names)

    def counts(self) -> dict[str, tuple[int, int]]:
        """Return the numbers of (episodes, transitions) of each mode, by name."""
        n_modes = len(self.mode_names)
        episodes = np.bincount(self.episode_modes, minlength=n_modes)
        transitions = np.bincount(self.mode, minlength=n_modes)
        return {
            name: (int(episodes[i]), int(transitions[i])) for i, name in enumerate(self.mode_names)
        }

    def summary(self) -> str:
        """Return one line with the numbers of episodes and transitions, in all and by mode."""
        modes = ", ".join(f"{name} {e}/{t}" for name, (e, t) in self.counts().items())
        return f"{self.n_episodes} episodes, {self.n_transitions} transitions ({modes})"

    def _check_whole(self) -> None:
        """Refuse to sum over episodes with missing steps: the sum would be wrong."""
        within = np.arange(self.n_transitions) - self.episode_starts[self.episode]
        last = np.diff(self.episode, append=self.n_episodes) != 0
        gaps = (self.step != within) | (last & (self.ending == Ending.NONE))
        if gaps.any():
            raise UserError(
                f"episode {self.episode[np.argmax(gaps)]} misses steps or its end, so its returns "
                "are not known: use the target kind instantaneous, or whole episodes"
            )

    def _take(
        self,
        rows: Int[np.ndarray, " kept"],
        episode: Int32[np.ndarray, " kept"],
        source: dict[str, Any],
    ) -> Demonstrations:
        arrays = {name: column[rows] for name, column in self.arrays().items()}
        arrays["episode"] = episode
        return Demonstrations.of_arrays(arrays, self.mode_names, self.n_actions, source)


_ADVANTAGES: WeakKeyDictionary[Demonstrations, dict[Any, RewardPair]] = WeakKeyDictionary()
