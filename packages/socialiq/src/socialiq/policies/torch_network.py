"""A policy's networks in PyTorch. Only `export_torch` imports this: PyTorch is an extra."""

from collections.abc import Sequence
from typing import Any

import torch  # pyright: ignore[reportMissingImports]

from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.ensemble import EnsemblePolicy
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.view import ALONG, BESIDE, PER_SECOND, SECONDS, Choice, OneHot, View

_ACTIVATIONS = {"relu": torch.nn.ReLU, "elu": torch.nn.ELU, "tanh": torch.nn.Tanh}


class QModule(torch.nn.Module):
    """Q values of a batch of observations, float32, with gradients."""

    def __init__(self, policy: QPolicy | ActorPolicy) -> None:
        super().__init__()
        self.view: Any = torch.nn.Identity()
        if isinstance(policy.view, OneHot):
            self.view = OneHotModule(policy.view)
        elif policy.view is not None:
            self.view = ViewModule(policy.view)
        self.layers = _affine(policy.weights)
        self.activation = _ACTIVATIONS[policy.activation]()

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Map (batch, features) to (batch, actions)."""
        value = self.view(observation)
        for number, layer in enumerate(self.layers):
            value = layer(self.activation(value) if number else value)
        return value


class ActorModule(QModule):
    """Deterministic action of a batch of observations, float32, with gradients."""

    def __init__(self, policy: ActorPolicy) -> None:
        super().__init__(policy)
        self.size = policy.action_size
        self.squash = policy.squash

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Map (batch, features) to (batch, size)."""
        mean = super().forward(observation)[:, : self.size]
        return torch.tanh(mean) if self.squash == "tanh" else mean.clamp(-1.0, 1.0)


class MeanModule(torch.nn.Module):
    """Mean of the members' Q values."""

    def __init__(self, members: Sequence[QPolicy]) -> None:
        super().__init__()
        self.members = torch.nn.ModuleList(QModule(member) for member in members)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Map (batch, features) to (batch, actions)."""
        return torch.stack([member(observation) for member in self.members]).mean(dim=0)


def module_of(policy: QPolicy | EnsemblePolicy | ActorPolicy) -> torch.nn.Module:
    """Return the module of a policy; its values come with the state dictionary."""
    if isinstance(policy, ActorPolicy):
        return ActorModule(policy)
    return MeanModule(policy.members) if isinstance(policy, EnsemblePolicy) else QModule(policy)


class OneHotModule(torch.nn.Module):
    """Integer features, one place for each value (`nn.view`)."""

    places: torch.Tensor
    values: torch.Tensor

    def __init__(self, view: OneHot) -> None:
        super().__init__()
        places = []
        numbers = []
        for number, (low, size) in enumerate(zip(view.lows, view.sizes, strict=True)):
            places += [number] * size
            numbers += list(range(low, low + size))
        self.register_buffer("places", torch.tensor(places), persistent=False)
        values = torch.tensor(numbers, dtype=torch.float32)
        self.register_buffer("values", values, persistent=False)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Map (batch, features) to (batch, places)."""
        return (observation[:, self.places] == self.values).to(torch.float32)


class ViewModule(torch.nn.Module):
    """Vehicles as the ego sees them, or as a set (`nn.view`)."""

    def __init__(self, view: View) -> None:
        super().__init__()
        self.choice: Choice = view.choice
        self.times = view.times
        self.layers = _affine(view.weights)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Map (batch, features) to the first layer's input."""
        if not self.times:
            return self._vehicles(observation)
        times = torch.arange(self.times, dtype=torch.float32, device=observation.device)
        time = (observation[:, -1:] == times).to(torch.float32)
        return torch.cat([time, self._vehicles(observation[:, :-1])], dim=-1)

    def _vehicles(self, observation: torch.Tensor) -> torch.Tensor:
        of_ego, of_user = self.choice.layout
        ego = observation[:, None, :of_ego]
        vehicles = observation[:, of_ego:].reshape(len(observation), -1, of_user)
        present = vehicles[..., :1]
        columns = [present, self._absolute(vehicles)] if self.choice.is_of_rows else [vehicles]
        if self.choice.is_of_rows and self.choice.relative:
            scale = self.choice.scale
            along = ego[..., 5:]
            position = _turned(vehicles[..., 1:3] - ego[..., 1:3], along)
            velocity = _turned(vehicles[..., 3:5] - ego[..., 3:5], along)
            columns += [scale * position, scale * velocity, _turned(vehicles[..., 5:], along)]
            if self.choice.ahead:
                columns.append(_closeness(position, velocity))
        value = torch.cat(columns, dim=-1) * present
        own = (self._absolute(ego) if self.choice.is_of_rows else ego)[:, 0]
        if not self.choice.pooled:
            return torch.cat([own, value.flatten(1)], dim=-1)
        for layer in self.layers:
            value = torch.relu(layer(value))
        value = value * present
        return torch.cat([own, value.sum(dim=1), value.amax(dim=1)], dim=-1)

    def _absolute(self, rows: torch.Tensor) -> torch.Tensor:
        return torch.cat([rows[..., 1:5] * self.choice.scale, rows[..., 5:]], dim=-1)


def _turned(vector: torch.Tensor, along: torch.Tensor) -> torch.Tensor:
    """Return components along a heading (cos, sin) and to its left."""
    x = vector[..., :1]
    y = vector[..., 1:]
    cos = along[..., :1]
    sin = along[..., 1:]
    return torch.cat([x * cos + y * sin, y * cos - x * sin], dim=-1)


def _closeness(position: torch.Tensor, velocity: torch.Tensor) -> torch.Tensor:
    """Return `nn.view.closeness` of tensors."""
    seconds = PER_SECOND * torch.tensor(SECONDS, device=position.device)
    ahead = (position[..., :1] + velocity[..., :1] * seconds) / ALONG
    beside = (position[..., 1:] + velocity[..., 1:] * seconds) / BESIDE
    close = torch.relu(1.0 - ahead.abs()) * torch.relu(1.0 - beside.abs())
    return torch.cat([close, close * ahead], dim=-1)


def _affine(weights: Any) -> torch.nn.ModuleList:
    """Return layers of these shapes; their values come with the state dictionary."""
    return torch.nn.ModuleList(
        torch.nn.Linear(weight.shape[1], weight.shape[0]) for weight in weights
    )
