"""The part that all learners share: a learner is a config, a loss with named terms, and an action.

`Learner` is trained by Adam with a target network, many runs in one compiled program
(`learners.fit`). To add a learner, write a subclass with a `loss` (docs/extend.md).
"""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from socialiq.errors import UserError
from socialiq.foreign import FAILURES, failure
from socialiq.learners import fit
from socialiq.learners.callbacks import Callbacks
from socialiq.learners.expert_table import ExpertTable
from socialiq.learners.settings import LearnerConfig, LearnerHyperparameters
from socialiq.learners.state import (
    History,
    HyperparameterArrays,
    TrainState,
    cosine,
    linear,
    stack,
)
from socialiq.nn.q_network import QNetwork, network_of
from socialiq.nn.q_policy import QPolicy
from socialiq.types import Transitions

Terms = dict[str, Float[Array, ""]]


@dataclass(frozen=True)
class Trained:
    """The outcome of a training call; arrays have a leading axis of runs.

    Attributes:
        learner: With what all runs share.
        hyperparameters: Of each run.
        state: Networks and optimiser.
        retained: What the learner keeps of the runs' carry (`Learner.retained`).
        history: What was recorded, (chunks, runs).
        failures: One line for each run that stopped early.
    """

    learner: Learner
    hyperparameters: tuple[Any, ...]
    state: TrainState
    retained: Any
    history: History
    failures: tuple[str, ...]

    def __repr__(self) -> str:
        """Return the outcome in a line, without weights."""
        size = f"{len(self.hyperparameters)} runs of {self.static.updates} updates"
        return f"Trained({self.learner.name}: {size}, failures={self.failures})"

    @property
    def static(self) -> Any:
        """Static configuration of all runs."""
        return self.learner.static

    @property
    def networks(self) -> Any:
        """Trained networks, arrays with a leading axis of runs."""
        return self.state.network

    def policy(self, run: int) -> Any:
        """Return the trained policy of one run; it can be saved."""
        state, remainder = (network_of(tree, run) for tree in (self.state, self.retained))
        return self.learner.policy(self.hyperparameters[run], state.deployed(), remainder)


class Learner(eqx.Module):
    """Base class of learners; a subclass writes `loss`, and overrides what else differs.

    Attributes:
        static: Frozen dataclass of choices that shape the program; `updates`, `batch_size` and
            the network's `hidden`, `activation` and `view` are read here.
        sizes: Length of an observation, and number of actions.
        table: Demonstrations; None without.
    """

    static: Any = eqx.field(static=True)
    sizes: tuple[int, int] = eqx.field(static=True)
    table: ExpertTable | None = None

    StaticConfig: ClassVar[type] = LearnerConfig
    """Dataclass of `static`."""
    Hyperparameters: ClassVar[type] = LearnerHyperparameters
    """Dataclass of a run's numbers."""
    name: ClassVar[str] = "learner"
    """Of the record of a trained policy."""
    has_target: ClassVar[bool] = True
    """Whether a target network follows the network, by the hyperparameter `polyak`."""
    target_kind: ClassVar[str] = "instantaneous"
    """Reading of "cumulative returns" in a batch's `target` (`social.returns`)."""

    @classmethod
    def of(cls, static: Any, datasets: Sequence[Transitions]) -> Any:
        """Make the learner of sets of demonstrations.

        Args:
            static: Config of all runs.
            datasets: Sets of demonstrations with discrete actions.

        Returns:
            The learner.

        Raises:
            UserError: If there is none, or they differ in features or actions.
        """
        table = ExpertTable.of(datasets, cls.target_kind, 1.0)
        sizes = (int(datasets[0].observation.shape[1]), int(datasets[0].n_actions))
        return cls(static, sizes, table)

    def loss(
        self,
        network: Any,
        target_network: Any,
        batch: Any,
        hyperparameters: HyperparameterArrays,
        /,
    ) -> tuple[Float[Array, ""], Terms]:
        """Return the loss of a batch and its terms.

        Args:
            network: The trained network.
            target_network: Running average of the network; None for a learner without one.
            batch: What `draw` returned.
            hyperparameters: Numbers of one run.

        Returns:
            The loss, a scalar, and scalar terms by name; "loss" is among them.
        """
        raise NotImplementedError

    def draw(
        self, hyperparameters: HyperparameterArrays, _state: TrainState, carry: Any, /
    ) -> tuple[Any, Any]:
        """Return a batch and the next carry: here demonstrations, and a random key.

        Args:
            hyperparameters: Numbers of one run.
            carry: Carry of the last update, here a random key.

        Returns:
            A batch of `batch_size` demonstrations from the run's set, and the next carry.
        """
        assert self.table is not None
        key, for_batch = jax.random.split(carry)
        batch = self.table.sample(for_batch, hyperparameters.dataset, self.static.batch_size)
        return batch, key

    def initialise(self, hyperparameters: HyperparameterArrays) -> tuple[TrainState, Any]:
        """Draw a network from the run's seed; return its state and the carry, a random key."""
        key, for_network = jax.random.split(jax.random.key(hyperparameters.seed))
        return self.first_state(self.network(for_network)), key

    def first_state(self, network: Any) -> TrainState:
        """Return the state of a run before its first update."""
        return TrainState.of(network, self.has_target, self.averaging > 0.0)

    @property
    def averaging(self) -> float:
        """Share by which weights are averaged; 0 for a static config that has no such field."""
        return getattr(self.static, "averaging", 0.0)

    def network(self, key: PRNGKeyArray) -> Any:
        """Draw a network."""
        static = self.static
        n_features, n_actions = self.sizes
        shape = (n_features, static.hidden, n_actions, static.activation, static.view)
        return QNetwork.initialise(key, *shape, scale=getattr(static, "input_scale", 1.0))

    def learning_rate(self, hyperparameters: HyperparameterArrays, done: Array) -> Any:
        """Return the learning rate of an update.

        It falls as a cosine to the share `final_rate` of a run that has one, linearly to the
        `final_learning_rate`, or else it is constant or falls to 0 by the `schedule`.

        Args:
            hyperparameters: Numbers of one run.
            done: Number of updates done.

        Returns:
            The rate. A subclass may return one for each part of its network (`TrainState.step`).
        """
        rate = hyperparameters.learning_rate
        updates = self.static.updates
        if hasattr(hyperparameters, "final_rate"):
            return cosine(rate, hyperparameters.final_rate, done, updates)
        if hasattr(hyperparameters, "final_learning_rate"):
            return linear(rate, hyperparameters.final_learning_rate, done, updates)
        constant = getattr(self.static, "schedule", "constant") == "constant"
        return rate if constant else rate * (1.0 - done / updates)

    def update(
        self, hyperparameters: HyperparameterArrays, state: TrainState, carry: Any
    ) -> tuple[TrainState, Any, Terms]:
        """Draw a batch and take one Adam step on the loss.

        Args:
            hyperparameters: Numbers of one run.
            state: State of the run.
            carry: Carry of the run.

        Returns:
            The next state and carry, and the terms of the loss.
        """
        batch, carry = self.draw(hyperparameters, state, carry)
        gradient, terms = jax.grad(self.loss, has_aux=True)(
            state.network, state.target_network, batch, hyperparameters
        )
        rate = self.learning_rate(hyperparameters, state.optimiser.count)
        polyak = hyperparameters.polyak if self.has_target else 0.0
        state = state.step(gradient, rate, polyak)
        return state.averaged(self.averaging) if self.averaging else state, carry, terms

    def retained(self, _carry: Any, /) -> Any:
        """Return the part of the carry that a policy needs: here none."""
        return None

    def policy(self, hyperparameters: Any, state: TrainState, _retained: Any = None, /) -> Any:
        """Return the policy of one run: greedy, or softmax(Q/τ) with its temperature, or τ = 1.

        Args:
            hyperparameters: Numbers of the run, for the temperature and the record.
            state: State of the run.

        Returns:
            The policy, which can be saved.
        """
        temperature = getattr(hyperparameters, "temperature", 1.0)
        return QPolicy.of(state.network, temperature, self.record(hyperparameters))

    def no_angle(self) -> str:
        """Return why no term of the objective reads an angle; "" if one does.

        Demonstrations without social rewards leave the best policy the same at every angle.
        """
        if self.table is None or bool(jnp.any(self.table.columns.target.social != 0.0)):
            return ""
        return "the demonstrations have no social rewards"

    def numbers(self, hyperparameters: Any) -> dict[str, Any]:
        """Return the numbers of a run by name; its angle is None where no term reads it."""
        numbers = dataclasses.asdict(hyperparameters)
        return numbers | {"angle": None} if "angle" in numbers and self.no_angle() else numbers

    def record(self, hyperparameters: Any) -> dict[str, Any]:
        """Return the JSON-able record of one run."""
        return {
            "learner": self.name,
            "structure": dataclasses.asdict(self.static),
            "numbers": self.numbers(hyperparameters),
        } | self.functions()

    def functions(self) -> dict[str, Any]:
        """Return what of the learner is the user's own code, by its part: name and SHA-256."""
        ours = type(self).__module__.startswith("socialiq.")
        return {} if ours else {"own_learner": described(type(self))}

    def run_name(self, hyperparameters: Any) -> str:
        """Return the name of a run in messages."""
        angle = getattr(hyperparameters, "angle", None)
        return ("" if angle is None else f"angle {angle:g}, ") + f"seed {hyperparameters.seed}"

    @classmethod
    def train_on(
        cls,
        static: Any,
        hyperparameters: Sequence[Any],
        datasets: Sequence[Transitions],
        callbacks: Callbacks | None = None,
        chunk: int = 500,
    ) -> Trained:
        """Train on sets of demonstrations alone, as `train`.

        Args:
            static: Config of all runs.
            hyperparameters: Numbers of each run; their `dataset` is the index of the run's set.
            datasets: Sets of demonstrations.
            callbacks: Progress, monitor, checkpoint.
            chunk: Updates between two calls of the callbacks.

        Returns:
            The trained runs.

        Raises:
            UserError: If there is no run, or no such set of demonstrations.
            Stopped: On Ctrl-C.
        """
        if not hyperparameters or max(run.dataset for run in hyperparameters) >= len(datasets):
            raise UserError("pass at least one run, and the demonstrations that each run names")
        return cls.of(static, datasets).train(hyperparameters, callbacks, chunk)

    def train(
        self,
        hyperparameters: Sequence[Any],
        callbacks: Callbacks | None = None,
        chunk: int = 500,
        before_chunk: fit.BeforeChunk | None = None,
        world: str = "",
    ) -> Trained:
        """Train one run for each entry of `hyperparameters`, all in one compiled program.

        Args:
            hyperparameters: Frozen dataclasses of numbers, with a `seed`, one for each run.
            callbacks: Progress, monitor, checkpoint.
            chunk: Updates between two calls of the callbacks.
            before_chunk: Adds experience from outside JAX (`learners.collect`).
            world: Description of the world; a checkpoint of another one is refused.

        Returns:
            The trained runs.

        Raises:
            UserError: If there is no run, code of the user's own fails, or two of a learner of the
                user's own are equal except for their angles.
            Stopped: On Ctrl-C.
        """
        if not hyperparameters:
            raise UserError("no runs: pass at least one set of hyperparameters")
        callbacks = callbacks or Callbacks()
        names = callbacks.run_names or tuple(self.run_name(run) for run in hyperparameters)
        arrays = stack(hyperparameters)
        if self.functions():
            _check_own(self, arrays[0])
        settings = (self.name, self.static, *hyperparameters, chunk, world, self.functions())
        runs, history, failures = fit.fit(
            self,
            arrays,
            self.static.updates,
            chunk,
            fit.fingerprint(self.table, *settings),
            dataclasses.replace(callbacks, run_names=names),
            before_chunk,
        )
        if self.functions() and not failures:
            _check_angles(hyperparameters, runs.state.network)
        remainder = self.retained(runs.carry)
        return Trained(self, tuple(hyperparameters), runs.state, remainder, history, failures)


def _check_angles(hyperparameters: Sequence[Any], networks: Any) -> None:
    """Refuse policies of the user's own learner that differ in their angle's label alone."""
    weights: dict[tuple[str, bytes], Any] = {}
    for run, numbers in enumerate(hyperparameters):
        values = dataclasses.asdict(numbers)
        angle = values.pop("angle", None)
        leaves = jax.tree.leaves(eqx.filter(network_of(networks, run), eqx.is_array))
        key = repr(values), b"".join(np.asarray(leaf).tobytes() for leaf in leaves)
        if weights.setdefault(key, angle) != angle:
            raise UserError(
                f"the policies of {weights[key]:g} and {angle:g} degrees are equal: the learner "
                "reads no angle: name one --angle, or read `hyperparameters.weights` in its loss"
            )


def _check_own(learner: Learner, hyperparameters: HyperparameterArrays) -> None:
    """Refuse code of the user's own that fails, or whose terms are not named scalars."""
    what = ", ".join(f"'{description['name']}'" for description in learner.functions().values())
    try:
        terms = jax.eval_shape(
            lambda run: learner.update(run, *learner.initialise(run))[2], hyperparameters
        )
    except UserError:
        raise
    except FAILURES as error:
        raise failure(what, error) from error
    if not isinstance(terms, dict) or "loss" not in terms:
        raise UserError(f"{what} must return (loss, terms), with 'loss' among the named terms")
    for name, term in terms.items():
        if getattr(term, "shape", None) != ():
            raise UserError(f"{what}: term '{name}' must be a scalar: take the mean over the rows")


def described(function: Any) -> dict[str, str]:
    """Return the name and the SHA-256 of the source of the user's own code."""
    try:
        source = inspect.getsource(function)
    except (OSError, TypeError):  # typed at a prompt, or an object
        code = getattr(function, "__code__", None)
        source = repr((code.co_code, code.co_consts) if code else type(function))
    name = getattr(function, "__qualname__", type(function).__qualname__)
    return {"name": name, "sha256": hashlib.sha256(source.encode()).hexdigest()}
