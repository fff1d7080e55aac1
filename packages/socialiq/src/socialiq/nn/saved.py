"""Saved form of policies: one file of `storage` for each, its kind in a registry.

A file's checksum detects damage; it is not a signature, and anyone can make it again. So the
header is checked against the arrays before anything is computed with them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from socialiq.errors import UserError
from socialiq.nn.view import Choice, Encoding, OneHot, View, ego_width, row_width
from socialiq.reading import path_of
from socialiq.storage import content_hash, kind_of, load_arrays, save_arrays

Arrays = Mapping[str, np.ndarray]
Header = Mapping[str, Any]

Form = TypeVar("Form", bound="Saved")
Network = TypeVar("Network", bound="SavedNetwork")

FORMS: dict[str, type[Saved]] = {}
"""Class of each kind of file."""

LOG_STD = (-5.0, 2.0)
"""Range of the logarithm of an actor's standard deviation before the tangent is taken. A narrower
policy has a density of e^5 for each number of an action, a wider one puts nearly all on the
bounds."""

MOST_LAYERS = 100
MOST_TIMES = 10_000
"""Values of the time that a view may tell apart."""

_FAULTS = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError)
"""Exceptions of a header that doesn't fit its arrays, when a policy is made of them."""


class Saved(ABC):
    """Base class of what is saved in one safetensors file; `KIND` registers a subclass."""

    KIND: ClassVar[str]
    """Kind of content in the file's header."""
    VERSIONS: ClassVar[tuple[int, ...]] = (1,)
    """Schema versions that are read."""

    def __init_subclass__(cls) -> None:
        """Enter the class into the registry."""
        super().__init_subclass__()
        if "KIND" in vars(cls):
            FORMS[cls.KIND] = cls

    def __repr__(self) -> str:
        """Return the class and the beginning of a hash of the content, without weights."""
        return f"{type(self).__name__} {content_hash(*self.content())[:8]}"

    @property
    def version(self) -> int:
        """Schema version that is written."""
        return self.VERSIONS[0]

    @abstractmethod
    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the file."""

    @classmethod
    @abstractmethod
    def checked(cls, path: Path, arrays: Arrays, header: Header) -> Any:
        """Build the object from a file's arrays and header, with `sha256` in it.

        Args:
            path: The file, which errors name.
            arrays: Named arrays of the file.
            header: Header of the file.

        Returns:
            The object.

        Raises:
            UserError: If they don't agree.
        """

    def save(self, path: str | Path, replace: bool = True) -> str:
        """Write one safetensors file.

        Args:
            path: The file, in a folder that exists.
            replace: Whether an existing file is replaced.

        Returns:
            SHA-256 of the content.

        Raises:
            UserError: If the file can't be written.
        """
        return save_arrays(path, self.KIND, self.version, *self.content(), replace=replace)

    @classmethod
    def load(cls: type[Form], path: str | Path) -> Form:
        """Read a file that `save` wrote.

        Raises:
            UserError: If the file is missing, damaged, or holds something else.
        """
        path = path_of(path)
        return cls.checked(path, *load_arrays(path, cls.KIND, cls.VERSIONS))


def noted(policy: Any, entries: Mapping[str, Any]) -> Any:
    """Return a policy or dial with further entries of its provenance.

    Args:
        policy: A policy, or a dial, whose `turned` is one.
        entries: The entries; without any the policy itself is returned.
    """
    if not entries:
        return policy
    if hasattr(policy, "turned"):
        return replace(policy, turned=noted(policy.turned, entries))
    return replace(policy, provenance={**policy.provenance, **entries})


def load_one_of(path: Path, classes: Sequence[type[Any]]) -> Any:
    """Read a file of one of several subclasses of `Saved`.

    Args:
        path: The file.
        classes: The classes that are accepted; the last one reads, and refuses, a file of any
            further kind.

    Returns:
        The object, of the class of the file's kind.

    Raises:
        UserError: If the file is missing, damaged, or holds something else.
    """
    form = FORMS.get(kind_of(path), classes[-1])
    return (form if form in classes else classes[-1]).load(path)


def refusal(path: Path, fault: str) -> UserError:
    """Return the error of a file whose parts don't agree.

    Args:
        path: The file.
        fault: Rest of the sentence that begins with the path, such as "lists no members".

    Returns:
        The error, for the caller to raise.
    """
    return UserError(f"{path} {fault}: make the file again")


ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
    "tanh": np.tanh,  # for imported policies; this project's networks are trained with the others
}
"""Activations of a policy, by name."""


class SavedNetwork(Saved):
    """Multi-layer perceptron of a policy, in NumPy, over the observation or a view of it.

    Attributes:
        weights: Weight matrix of each layer, (outputs, inputs).
        biases: Bias of each layer.
        activation: One of `ACTIVATIONS`, applied between layers.
        provenance: JSON-compatible record of how the policy was made.
        view: Encoding of the observation that the first layer reads, with NumPy weights.
        sha256: SHA-256 of the file's content, for a policy that was loaded.
    """

    SETTINGS: ClassVar[tuple[str, ...]]
    """Fields beside layers, view and provenance, which the header has."""
    NO_VIEW: ClassVar[dict[str, None]] = {}
    """Text of the header where a policy has no view."""

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    activation: str
    provenance: Mapping[str, Any]
    view: Encoding | None
    sha256: str

    @property
    def n_features(self) -> int:
        """Length of an observation."""
        return self.view.n_features if self.view else self.weights[0].shape[1]

    def forward(self, batch: np.ndarray) -> np.ndarray:
        """Return the outputs of the last layer for a batch of checked observations."""
        return self.layers(self.view(batch) if self.view else batch)

    def layers(self, inputs: np.ndarray) -> np.ndarray:
        """Return the outputs of the last layer for the first layer's inputs, (batch, inputs)."""
        return self.hidden(inputs) @ self.weights[-1].T + self.biases[-1]

    def hidden(self, inputs: np.ndarray) -> np.ndarray:
        """Return the outputs of the last hidden layer for the first layer's inputs."""
        value = inputs
        activation = ACTIVATIONS[self.activation]
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            value = activation(value @ weight.T + bias)
        return value

    @abstractmethod
    def has_sound_settings(self) -> bool:
        """Whether `SETTINGS` have their types and ranges, and fit the last layer."""

    def content(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return the named arrays and the header of the policy's file."""
        arrays = _named_layers("", self.weights, self.biases)
        header = {
            "activation": self.activation,
            **{name: getattr(self, name) for name in self.SETTINGS},
            "layers": len(self.weights),
            **self.NO_VIEW,
            "provenance": dict(self.provenance),
        }
        if isinstance(self.view, OneHot):
            header |= {"one_hot": {"lows": self.view.lows, "sizes": self.view.sizes}}
        elif self.view is not None:
            view = self.view.choice.described()
            view |= {"layers": len(self.view.weights), "n_features": self.view.n_features}
            header["view"] = view | ({"times": self.view.times} if self.view.times else {})
            arrays |= _named_layers("view_", self.view.weights, self.view.biases)
        return arrays, header

    @classmethod
    def checked(
        cls: type[Network], path: Path, arrays: Arrays, header: Header, extra: int = 0
    ) -> Network:
        """Build the policy as `Saved.checked`.

        Args:
            path: The file, which errors name.
            arrays: Named arrays of the file.
            header: Header of the file.
            extra: Number of the first layer's inputs that are not part of the observation.

        Returns:
            The policy.

        Raises:
            UserError: If arrays and header don't agree, or a weight is not a finite number.
        """
        count = header.get("layers")
        if type(count) is not int or not 1 <= count <= MOST_LAYERS:
            raise refusal(path, f"must have 1 to {MOST_LAYERS} layers")
        for array in arrays.values():
            if array.dtype.kind != "f" or not np.isfinite(array).all():
                raise refusal(path, "has a weight that is not a finite number")
        unchained = refusal(path, "has layers that don't follow one another")
        try:
            policy = cls(**_fields_of(cls, arrays, header))
            plain = policy.activation in ACTIVATIONS and isinstance(policy.provenance, dict)
            sound = plain and policy.has_sound_settings() and _is_possible(policy.view)
            if sound:  # before anything is computed: a header may claim widths of any size
                width = policy.view.width if policy.view else policy.weights[0].shape[1] - extra
                sound = width > 0 and _chained(policy.weights, policy.biases, width + extra)
        except UserError:  # the class refuses a value, and would name no file
            raise unchained from None
        except _FAULTS as error:
            raise refusal(path, "has a header that doesn't fit its arrays") from error
        if not sound:
            raise unchained
        return policy


def _fields_of(kind: type[SavedNetwork], arrays: Arrays, header: Header) -> dict[str, Any]:
    """Return the fields of a policy in a file's content, the inverse of `content`."""
    view: Encoding | None = None
    header = header if kind.NO_VIEW else {"view": None, **header}
    if places := header.get("one_hot"):
        view = OneHot(tuple(places["lows"]), tuple(places["sizes"]))
    elif described := header["view"]:
        weights, biases = _layers_named("view_", described["layers"], arrays)
        times = described.get("times", 0)
        choice = Choice.of_described(described)
        view = View(weights, biases, choice, described["n_features"], times)
    weights, biases = _layers_named("", header["layers"], arrays)
    return {name: header[name] for name in kind.SETTINGS} | {
        "weights": weights,
        "biases": biases,
        "activation": header["activation"],
        "provenance": header["provenance"],
        "view": view,
        "sha256": header["sha256"],
    }


def _named_layers(prefix: str, weights: Sequence[Any], biases: Sequence[Any]) -> dict[str, Any]:
    arrays = {f"{prefix}weight_{number}": weight for number, weight in enumerate(weights)}
    return arrays | {f"{prefix}bias_{number}": bias for number, bias in enumerate(biases)}


def _layers_named(prefix: str, count: int, arrays: Arrays) -> tuple[Any, Any]:
    weights = tuple(arrays[f"{prefix}weight_{number}"] for number in range(count))
    return weights, tuple(arrays[f"{prefix}bias_{number}"] for number in range(count))


def _is_possible(view: Any) -> bool:
    """Whether a view's numbers are ones that `View` and `OneHot` produce."""
    if view is None:
        return True
    if isinstance(view, OneHot):
        return len(view.lows) == len(view.sizes) and all(
            type(low) is int and type(size) is int and size > 0
            for low, size in zip(view.lows, view.sizes, strict=True)
        )
    pooled, relative, scale, ahead, layout = view.choice
    flags = all(type(flag) is bool for flag in (pooled, relative, ahead))
    plain = isinstance(scale, float) and flags and (relative or not ahead)
    if not (type(view.n_features) is int and type(view.times) is int):
        return False
    listed = view.n_features - bool(view.times)
    fitting = view.choice.fitting(listed)
    rows = fitting is not None and fitting.layout == layout and 0 <= view.times <= MOST_TIMES
    if not (plain and rows and np.isfinite(scale) and pooled == bool(view.weights)):
        return False
    if not pooled:
        return True
    encoded = (view.width - view.times - ego_width(view.choice)) // 2
    inputs = row_width(view.choice)
    return _chained(view.weights, view.biases, inputs) and len(view.biases[-1]) == encoded


def _chained(weights: Sequence[Any], biases: Sequence[Any], inputs: int) -> bool:
    """Whether each layer takes the outputs of the one before it, the first one `inputs` numbers."""
    for weight, bias in zip(weights, biases, strict=True):
        if weight.ndim != 2 or bias.shape != weight.shape[:1] or weight.shape[1] != inputs:
            return False
        inputs = len(bias)
    return inputs > 0
