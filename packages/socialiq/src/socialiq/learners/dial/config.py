"""Settings of the dial and of the offline dial: configs, hyperparameters, presets."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from socialiq.errors import UserError
from socialiq.learners import settings
from socialiq.learners.iq_learn.config import Endings
from socialiq.learners.settings import Count, NotNegative, Positive, Share
from socialiq.types import Simulator, Transitions


@dataclass(frozen=True, kw_only=True)
class DialConfig(settings.DrawnAngles, settings.Network, settings.Replay):
    """Choices that shape the program. Defaults: the 7x7 world with its clock, online."""

    online: bool = True
    """Whether the learner acts in a world and keeps a replay; offline it sees only the data."""
    demonstrations: bool = True
    """Whether it sees demonstrations; without them it is soft Q-learning on R(α)."""
    scored: Literal["all", "demonstrations"] = "all"
    """Transitions on which r̂ is drawn to λR(α): all, for whose own steps the world must give the
    reward pair, or demonstrations only."""
    endings: Endings = field(default_factory=Endings)
    """Value of V(s') after each kind of ending. A timeout is an end like others to a learner that
    sees the clock."""
    redraw_times: settings.Natural = 0
    """Horizon of a clock, the last feature: every transition is learned from at a newly drawn time.
    0 leaves times as they are. Right where neither dynamics nor rewards depend on the time."""
    redraw_share: Share = 1.0
    """Share of the rows whose times are redrawn; the others keep theirs."""
    timeout_reward: settings.Finite = 0.0
    """r_env of a timeout itself, which moves with the time where times are redrawn."""
    backup: Literal["soft", "hard", "double"] = "soft"
    """V(s') of the target: "soft" is Eq 2.5, "hard" the largest value, "double" the target
    network's value of the action that is the best by the network (van Hasselt et al. 2016)."""
    heads: Literal["score", "pair"] = "score"
    """Outputs for each action: "score" is Q of R(α); "pair" is (Q_env, Q_social) of the policy of
    the angle, each learned from its own reward; their score is Q. Not with a soft backup."""
    classes: bool = False
    """Whether the class angle of r_social is an input too, drawn like the angle, and the outputs of
    heads "pair" are of three rewards. In worlds that have classes, and without demonstrations."""
    driven_share: Share = 0.0
    """Share of the learner's own rows at the angle at which they were driven; for the others an
    angle is drawn."""
    knots: settings.Natural = 0
    """Number of hat functions of the angle that the network reads beside (cos α, sin α), at equal
    distances over the drawn angles; 0 for none (`nn.dial_network.hats`)."""
    hidden: settings.Widths = (128, 128)
    one_hot: tuple[tuple[int, int], ...] = ()
    """For observations of integers: smallest value and number of values of each feature, which
    the network then sees one place for each value. None: it sees the view."""
    expert_batch: Count = 64
    """Demonstrated transitions of an update."""
    replay_batch: Count = 192
    """The learner's own transitions of an update."""
    updates: Count = 24_000
    """Gradient steps of a run."""
    averaging: Share = 0.0
    """Share of the network that each update mixes into the average of its weights, of which the
    policy is then made; 0: it is made of the target network."""
    environments: Count = 4
    """Worlds side by side in which the learner takes one step each before a gradient step."""

    def __post_init__(self) -> None:
        """Refuse names, sizes and combinations that make no run."""
        super().__post_init__()
        if not self.online and not self.demonstrations:
            raise UserError("offline and without demonstrations there is nothing to learn from")
        if not self.demonstrations and self.scored == "demonstrations":
            raise UserError("--set scored=demonstrations needs demonstrations: choose all")
        if self.heads == "pair" and self.backup == "soft":
            raise UserError("--set heads=pair has no soft backup: add --set backup=hard or double")
        if self.classes and (self.demonstrations or not self.online):
            raise UserError(
                "--set classes=true learns in a world alone: --set demonstrations=false"
            )
        if self.classes and self.knots:
            raise UserError("--set knots is of one angle: leave it out with --set classes=true")
        if self.knots == 1 or (self.knots and not self.margin and self.low == self.high):
            raise UserError("--set knots: give 0, or at least 2 and a range of angles")
        if self.driven_share and not self.online:
            raise UserError(
                "--set driven_share is of the learner's own rows: train online, or leave it"
            )
        self.check_high_share()

    @property
    def times(self) -> int:
        """Number of values of the time that the view of the network tells apart; 0 for none."""
        return self.redraw_times if self.view != "flat" and not self.one_hot else 0


@dataclass(frozen=True, kw_only=True)
class DialHyperparameters(settings.CosineRate, settings.Dataset):
    """Numbers of one run; all are traced, so a whole grid of them shares one program."""

    strength: NotNegative = 1.0
    """λ: scales the centre λR(α). With τ it decides how sharp the policy is."""
    prior_weight: NotNegative = 1000.0
    """w: weight of the squared distance to λR(α) beside IQ-Learn's terms. r̂ leaves the centre by
    about 1/w, so a small w imitates and a large one obeys."""
    temperature: Positive = 0.02
    """τ of Eq 2.5."""
    discount: Share = 1.0
    """γ. With a clock the horizon is finite, and 1 is what the regret is counted with."""
    chi2_alpha: Positive = 0.5
    """α_χ: the squared term is w / (4 α_χ) (r̂ - λR(α))²."""
    learning_rate: Positive = 1e-3
    polyak: settings.Rate = 0.01
    exploration: Share = 0.1
    """Share of random actions while acting; the others are drawn from softmax(Q/τ)."""


@dataclass(frozen=True, kw_only=True)
class OfflineDialConfig(settings.DrawnAngles, settings.LearnerConfig):
    """Choices that shape the program. Defaults: the intersection."""

    high_from: float = 77.0
    high_share: Share | None = 0.4
    """Share of the drawn angles beyond `high_from`, if the range reaches there; None: uniform. From
    there to 90 degrees policies change from driving to waiting."""
    members: Count = 1
    """Critics, trained on the same rows from different weights; their mean is used."""
    one_hot: tuple[tuple[int, int], ...] = ()
    """For observations of integers: smallest value and number of values of each feature, which the
    networks then see one place for each value. None: they see the view."""
    hidden: settings.Widths = (128, 128)
    view: settings.ViewName = "set"
    batch_size: Count = 256
    updates: Count = 5000
    """Gradient steps of the behaviour policy, and of the dial."""
    critic_factor: Count = 2
    """Gradient steps of the critics, over those of the other two."""
    own_scale: bool = False
    """Whether features and rewards keep the scale of their data: the networks see each feature with
    mean 0 and deviation 1 over the data, and η is a share of the spread of the score's
    returns-to-go. For data of no world of ours; only with view flat."""
    whole_episode: settings.Natural = 0
    """Decisions of a whole episode, where recordings end before it: a timeout before that many is
    the end of a view, behind which values go on. 0: every timeout ends an episode."""

    def __post_init__(self) -> None:
        """Refuse names, sizes and ranges that make no run."""
        super().__post_init__()
        if (self.input_scale, self.schedule, self.averaging) != (1.0, "constant", 0.0):
            raise UserError(
                "the offline dial has a scale, a schedule and an average of its own: leave out "
                "--set input_scale, schedule and averaging"
            )
        if self.own_scale and (self.view != "flat" or self.one_hot):
            raise UserError("--set own_scale=true is of --set view=flat: leave it out")

    @property
    def without_idle_share(self) -> OfflineDialConfig:
        """Return this config, without a high share where the range doesn't reach beyond it."""
        reaches = self.low < self.high_from < self.high
        return self if reaches else dataclasses.replace(self, high_share=None)


@dataclass(frozen=True, kw_only=True)
class OfflineDialHyperparameters(settings.CosineRate):
    """Numbers of one run, all traced. The learning rate falls in each of the three stages."""

    temperature: Positive = 0.1
    """η from 30 to 60 degrees, in units of reward: the price of a nat of distance from the
    behaviour policy. Small values choose the best supported action, large ones clone."""
    end_temperature: Positive = 0.3
    """η up to 15 degrees and from 75 on; between, it changes with sin 2α. Where one reward decides
    alone, fewer demonstrators are overruled, and a critic's errors cost more."""
    discount: Share = 1.0
    """γ. The critics observe the time, so a finite horizon needs none."""
    learning_rate: Positive = 1e-3
    polyak: settings.Rate = 0.01
    dataset: settings.Natural = 0
    """Number of the run among those trained together, each with data of its own; set by them."""


# Chosen on training seeds 0 and 1 of three environments; the study own-data measures them on six.
OWN_DATA = {"view": "flat", "own_scale": True, "high_share": None, "updates": 2000} | {
    "temperature": 0.05,
    "end_temperature": 0.05,
}
"""Settings of the offline dial for data of no world of ours, by name."""


def check_fit(
    static: DialConfig,
    hyperparameters: Sequence[DialHyperparameters],
    datasets: Sequence[Transitions],
    simulator: Simulator | None,
    sizes: tuple[int, int] | None,
    collects: bool,
) -> tuple[int, int]:
    """Return (features, actions) of runs that fit data and world.

    Args:
        static: Config of all runs.
        hyperparameters: Numbers of each run.
        datasets: Sets of demonstrations.
        simulator: The world to act in; None without.
        sizes: (features, actions) that the caller gives; None if data or world tell.
        collects: Whether experience comes from outside JAX.

    Returns:
        The sizes.

    Raises:
        UserError: As `settings.check_fit`.
    """
    sets = len(datasets) if static.demonstrations else None
    shapes = [(data.observation.shape[1], data.n_actions) for data in datasets]
    shapes += [(simulator.n_features, simulator.n_actions)] if simulator is not None else []
    acts = simulator is not None or collects
    return settings.check_fit(
        hyperparameters, sets, static.online, acts, [*shapes, sizes] if sizes else shapes
    )


class DialPreset(NamedTuple):
    """One way to train a dial.

    Attributes:
        structure: Its structure; what the network sees of the world is added.
        numbers: Its numbers; the seed is added.
        clock: Whether the world shows the time.
        support: Which actions an offline learner can know: at the time at which they were
            demonstrated ("timed"), or at any ("any time"); empty online.
    """

    structure: DialConfig
    numbers: DialHyperparameters
    clock: bool = True
    support: str = ""


_ONLINE = DialConfig(redraw_times=25, replay_batch=448)
_OFFLINE = DialConfig(online=False, scored="demonstrations")
# Chosen on training seeds 0 to 4 (docs/dial.md).
RUNS = {
    "online": DialPreset(_ONLINE, DialHyperparameters()),
    "online-alone": DialPreset(
        dataclasses.replace(_ONLINE, demonstrations=False, replay_batch=512), DialHyperparameters()
    ),
    "online-clockless": DialPreset(
        dataclasses.replace(_ONLINE, redraw_times=0),
        DialHyperparameters(discount=0.99),
        clock=False,
    ),
    "offline": DialPreset(
        dataclasses.replace(_OFFLINE, updates=12_000),
        DialHyperparameters(prior_weight=50.0, temperature=0.03),
        support="timed",
    ),
    "offline-redrawn": DialPreset(
        dataclasses.replace(_OFFLINE, updates=16_000, redraw_times=25),
        DialHyperparameters(prior_weight=200.0),
        support="any time",
    ),
}


# Chosen on training seeds 0 to 4; what it costs and what it reaches: docs/benchmarks.md.
QUICK = DialPreset(
    dataclasses.replace(_ONLINE, hidden=(64, 64), expert_batch=8, replay_batch=120, updates=6000),
    DialHyperparameters(learning_rate=6e-3, polyak=0.05),
)


# Chosen on training seeds 100 to 119 (docs/dial.md).
SHORT = DialPreset(
    dataclasses.replace(
        _ONLINE, knots=21, expert_batch=16, replay_batch=112, updates=20_000, averaging=0.002
    ),
    DialHyperparameters(learning_rate=5e-3, polyak=0.05, temperature=0.005),
)


# Chosen on training seeds 100 and 101 (docs/worlds/crosswalk7.md).
CLASSES = DialPreset(
    DialConfig(
        classes=True,
        demonstrations=False,
        redraw_times=25,
        backup="double",
        hidden=(128, 128, 128),
        high_from=70.0,
        high_share=0.4,
        replay_batch=512,
        replay_capacity=400_000,
        environments=16,
        averaging=0.0005,
        updates=160_000,
    ),
    DialHyperparameters(learning_rate=2e-3, exploration=0.2),
)
"""Social angle and class angle, in a world with classes of road users."""


# Chosen on training seed 100 (docs/reproduction/intersection-dial.md).
INTERSECTION = DialPreset(
    DialConfig(
        view="set",
        hidden=(256, 256),
        redraw_times=20,
        timeout_reward=-0.5,
        backup="double",
        heads="pair",
        high_share=0.4,
        driven_share=0.6,
        updates=40_000,
        environments=48,
        replay_capacity=200_000,
    ),
    DialHyperparameters(
        temperature=0.03, learning_rate=4e-3, final_rate=0.03, polyak=0.08, exploration=0.05
    ),
)
"""The intersection, with its clock."""


PRESETS = RUNS | {"online-short": SHORT, "online-quick": QUICK, "online-classes": CLASSES}
"""The study's runs, one with a fifth of the rows of `online`, one that takes less than twice the
time of a run of the thesis' learner, and one for two angles."""


# The time is not observed and units of reward are the user's: the target has no entropy.
ENVIRONMENT = DialPreset(
    DialConfig(demonstrations=False, backup="double", heads="pair", replay_batch=256),
    DialHyperparameters(temperature=0.03, discount=0.99),
    clock=False,
)
IN_ENVIRONMENTS = {"environment": ENVIRONMENT} | {
    name: RUNS[name] for name in ("online-clockless", "offline")
}
"""Presets of an environment of a user."""
