"""`export`, `turn`, `unlikeness` and `ensemble`: policies for other programs, made of others."""

import functools
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from socialiq.cli.drivers import OnRoads, driver_of, with_one_ego
from socialiq.cli.output import Printing, Result, listed
from socialiq.cli.parser import Paths
from socialiq.errors import UserError, one_of
from socialiq.evaluation.episodes import SIDE_BY_SIDE
from socialiq.evaluation.simulate import observations_of
from socialiq.foreign import one_line
from socialiq.learners.settings import check_seed
from socialiq.nn.actor_policy import ActorDial
from socialiq.nn.class_dial import ClassDial
from socialiq.nn.dial_policy import DialPolicy
from socialiq.nn.ensemble import EnsemblePolicy, load_values
from socialiq.nn.q_policy import QPolicy
from socialiq.nn.saved import Saved
from socialiq.nn.unlikeness import Unlikeness
from socialiq.outputs import all_or_none, new_folder, refuse_existing
from socialiq.policies import card, export, load
from socialiq.policies.drivers import Driver, file_of, parse
from socialiq.policies.load import name_of
from socialiq.reading import sha256_of_file
from socialiq.social.angle_rule import load_rule
from socialiq.storage import kind_of, read_json, write_atomically
from socialiq.types import Row
from socialiq.worlds import grammar
from socialiq.worlds.catalogue import NAMES, ROADS
from socialiq.worlds.highway.perception import FrontEnd
from socialiq.worlds.intersection import atlas
from socialiq.worlds.situation import ContextPolicy

FORMATS = {
    "onnx": (".onnx",),
    "torch": (".safetensors",),
    "card": (".md", ".txt"),
    "bom": (".json",),
}
"""Endings of a file's name, by its format; `HUB` is a folder."""
HUB = "hub"


@dataclass(frozen=True)
class Export(Printing):
    """Write a policy as ONNX, as weights for PyTorch, as a model card, or its bill of materials.

    ONNX has the values of all actions and the best action as outputs, or of continuous actions the
    action. The card is Markdown, with
    blanks for missing information. The bill of materials has the same facts as CycloneDX 1.7. A
    folder as model hubs keep it has the policy's file and the card as README.md.

    Example: socialiq export prosocial --format onnx --out prosocial.onnx
    """

    policy: Annotated[str, tyro.conf.Positional]
    """Policy, ensemble or dial file, or the name of a policy of the atlas."""
    format: str
    """onnx, torch (weights as safetensors, by the names of the torch module), card, bom,
    or hub."""
    out: Path
    """File to write, of hub the folder; must not exist."""
    angle: float | None = None
    """Social angle of a dial, in degrees."""
    front_end: str = ""
    """Perception before a policy, in the graph of ONNX: latency=1,track=3. The graph then takes
    what the sensors show and a memory, and returns the next memory."""
    world: str = "intersection"
    """Road of the front end with its options, as merge or intersection,control=continuous."""
    evaluation: Path | None = None
    """JSON output of `socialiq evaluate POLICY --json`, for the card."""

    def result(self) -> Result:
        """Read the policy and write the file."""
        one_of("format", self.format, (*FORMATS, HUB))
        if self.evaluation and self.format not in ("card", "bom", HUB):
            raise UserError("an evaluation goes into a card: add --format card, bom or hub")
        if self._driver.front_end and self.format != "onnx":
            raise UserError("a front end is of --format onnx: leave out --front-end")
        if self.world != Export.world and not self._driver.front_end:
            raise UserError("--world is the road of a front end: add --front-end, or leave it out")
        if self.format == HUB:
            return self.folder()
        refuse_existing(self.out, *FORMATS[self.format])
        policy, training = self.read()
        if self.format not in ("onnx", "torch"):
            content = self.described(policy, training)
        elif isinstance(policy, ContextPolicy):
            raise UserError(
                "a policy with an angle rule is a network and a rule: export the dial at one "
                "angle, or give --format card or bom"
            )
        else:
            onnx = functools.partial(export.to_onnx, front_end=self.sensing())
            content = (onnx if self.format == "onnx" else export.to_safetensors)(policy)
        write_atomically(self.out, content, replace=False)
        written = {"out": str(self.out), "format": self.format, "bytes": len(content)}
        written |= {"sha256": hashlib.sha256(content).hexdigest()}
        return Result(written, [written])

    def sensing(self) -> FrontEnd | None:
        """Return the front end of the road, if there is one."""
        front_end = self._driver.front_end
        if not front_end:
            return None
        written = grammar.parse(self.world)
        one_of("world", written.name, ROADS)
        road: Any = with_one_ego(written)
        return replace(FrontEnd.of(front_end), ego=road.ego)

    def folder(self) -> Result:
        """Write the policy's file and its card into a new folder."""
        policy, training = self.read()
        with all_or_none(new_folder(self.out)):
            policy.save(self.out / "policy.safetensors")
            write_atomically(self.out / "README.md", self.described(policy, training))
        written = {"out": str(self.out), "format": HUB}
        return Result(written, [written])

    @property
    def _driver(self) -> Driver:
        """The policy, with its angle and front end by either way of writing them."""
        driver = parse(self.policy)
        front_end = self.front_end or driver.front_end
        return driver._replace(angle=driver.at(self.angle), front_end=front_end)

    @property
    def _path(self) -> Path | None:
        """File of the policy; None for an object that a function got."""
        spec = file_of(self._driver.spec)
        return Path(spec) if isinstance(spec, str) else None

    def read(self) -> tuple[card.Exported, dict[str, Any]]:
        """Return the policy, and further records of its training."""
        spec: Any = file_of(self._driver.spec)
        angle = self._driver.angle
        path = self._path
        shipped = spec in atlas.names()
        if path and not shipped and not path.exists():
            names = ", ".join(atlas.names())
            raise UserError(f"no policy '{one_line(spec)}': name a file, or one of {names}")
        kind = "" if shipped else kind_of(path) if path else getattr(spec, "KIND", "")
        if kind in (DialPolicy.KIND, ActorDial.KIND, ClassDial.KIND):
            of_class = self._driver.class_angle
            if angle is None:
                raise UserError(f"{name_of(spec)} is a dial: add --angle")
            if kind == ClassDial.KIND and of_class is None:
                raise UserError(f"{name_of(spec)} is a dial of two angles: write @{angle:g}/0")
            if path:
                return load.read_native(path, None, angle, of_class)[0], {}
            return (spec if of_class is None else spec.of_class(of_class)).at(angle), {}
        if angle is not None:
            raise UserError(f"{one_line(name_of(spec))} is not a dial: leave --angle out")
        if path is None:
            return spec, {}
        if shipped:
            return atlas.load(spec), atlas.manifest()[spec]
        policy, _ = load.read_native(path, None)
        record = path.parent / "run.json"
        if kind == ContextPolicy.KIND or not record.is_file():
            return policy, {}
        training = _object(record)  # of a run beside the policy, if it belongs to it
        listed = training.get("policies")
        hashes = [entry.get("sha256") for entry in listed or () if isinstance(entry, dict)]
        belongs = policy.sha256 in hashes
        return policy, {**training, "made_by": "socialiq train"} if belongs else {}

    def described(self, policy: card.Exported, training: dict[str, Any]) -> bytes:
        """Return the model card, or the bill of materials.

        Args:
            policy: The policy.
            training: Records of its training; empty if they are not known.

        Returns:
            UTF-8 text: Markdown, or JSON if the format is "bom".
        """
        evaluation = training.get("greedy")
        words = ""
        if evaluation is not None:
            words = "By the study that made it, taking the best action always."
        if self.evaluation is not None:
            evaluation = _object(self.evaluation)
            digest = sha256_of_file(self.evaluation)
            words = (
                f"By the file {one_line(self.evaluation.name, 80)}, SHA-256 {digest}. It does not "
                "name its policy; the author of this card states it."
            )
        angle = self._driver.angle
        spec = self._driver.spec
        at = "" if angle is None else f" at {angle:g} degrees"
        name = f"{Path(name_of(spec)).stem}{at}"
        facts: dict[str, Any] = {"training": training, "evaluation": evaluation}
        if self.format != "bom":
            return card.model_card(policy, name, evaluated_by=words, **facts).encode()
        file = self._path if angle is None else None  # a dial's file holds many
        sha256 = sha256_of_file(file) if file is not None and file.is_file() else ""
        return card.card_materials(policy, name, file_sha256=sha256, **facts)


def _object(path: Path) -> dict[str, Any]:
    content = read_json(path)
    if not isinstance(content, dict):
        raise UserError(
            f"{path} is not a JSON object: write it with socialiq evaluate POLICY --json"
        )
    return content


@dataclass(frozen=True)
class Turn(Printing):
    """Write a dial's policy at one angle, or at an angle that follows a rule, as a policy file.

    Example: socialiq turn run/dial_0.safetensors --angle 30 --out prosocial.safetensors
    """

    dial: Annotated[Path, tyro.conf.Positional]
    """Dial file, of `socialiq train dial`; or `driver`, which ships."""
    out: Path
    """Policy file to write."""
    angle: float | None = None
    """Social angle in degrees."""
    class_angle: float | None = None
    """Class angle in degrees, of a dial of two angles: 0 weighs effects on vehicles alone, 90 those
    on road users who can be hurt alone. Without --angle the result is a dial."""
    angle_rule: Path | None = None
    """TOML file of a rule that gives the angle by the situation, in the place of --angle."""

    def run(self) -> int:
        """Turn and write."""
        refuse_existing(self.out)
        kind = kind_of(self._file)
        if (kind == ClassDial.KIND) != (self.class_angle is not None):
            of = "two angles: add" if kind == ClassDial.KIND else "one angle: leave out"
            raise UserError(f"{self.dial} is a dial of {of} --class-angle")
        turned: dict[str, Any] = (
            {} if self.class_angle is None else {"class_angle": self.class_angle}
        )
        if turned and self.angle is None and self.angle_rule is None:
            return self._written(self._dial(kind), turned)
        if (self.angle is None) == (self.angle_rule is None):
            raise UserError(
                "a dial is turned to one angle or by one rule: give --angle DEGREES, "
                "or --angle-rule FILE"
            )
        if self.angle is not None:
            policy = self._dial(kind).at(self.angle)
            turned = turned | {"angle": self.angle}
        elif kind == ActorDial.KIND or self.angle_rule is None:
            raise UserError(
                f"{self.dial} has continuous actions: a rule turns a dial of "
                "discrete ones; give --angle"
            )
        else:
            rule = load_rule(self.angle_rule)
            policy = ContextPolicy.of(self._dial(kind), rule)
            turned |= {"angle": "by rule", "contexts": "; ".join(rule.contexts)}
        return self._written(policy, turned)

    @property
    def _file(self) -> Path:
        """The dial's file."""
        return Path(file_of(str(self.dial)))

    def _dial(self, kind: str) -> Any:
        """Return the dial of the file, one of two angles at its class angle."""
        if self.class_angle is not None:
            return ClassDial.load(self._file).of_class(self.class_angle)
        return (ActorDial if kind == ActorDial.KIND else DialPolicy).load(self._file)

    def _written(self, policy: Saved, turned: dict[str, Any]) -> int:
        """Write the policy, or the dial, and print what was written."""
        sha256 = policy.save(self.out, replace=False)
        written = {"out": str(self.out), **turned, "sha256": sha256}
        return self.show(written, [written])


@dataclass(frozen=True)
class Score(Printing):
    """Write a policy with a score of how unlike its training world a state is.

    It drives three blocks of episodes in its declared world. The score is fitted on the first, its
    thresholds by rates of false alarms on the second, and three rates are tested on the third.
    `evaluate --fallback` uses the score, and ONNX has it as an output.

    Example: socialiq unlikeness dial.safetensors --angle 45 --out driver.safetensors
    """

    policy: Annotated[Path, tyro.conf.Positional]
    """Policy file with discrete actions, a dial, or a name of the atlas."""
    out: Path
    """Policy file to write."""
    angle: float | None = None
    """Social angle of a dial, in degrees."""
    world: str = "intersection"
    """The declared world: a road, or a gridworld."""
    shift: str = ""
    """Shift of the declared world, as of `socialiq evaluate`."""
    front_end: str = ""
    """Perception before the policy, as of `socialiq evaluate`."""
    episodes: int = 500
    """Episodes of each block."""
    seed: int = 0
    """Seed of the first episode."""

    def run(self) -> int:
        """Drive, fit, write, test, print."""
        check_seed(self.seed)
        sensed = OnRoads(shift=self.shift, front_end=self.front_end).written(
            self.world, [self.policy]
        )
        one_of("world", sensed.name, NAMES)
        refuse_existing(self.out)
        if self.episodes < 2:
            raise UserError(f"--episodes {self.episodes}: give 2 or more")
        world: Any = with_one_ego(sensed)
        policy = driver_of(str(self.policy), world, self.angle).policy
        if not isinstance(policy, QPolicy):
            raise UserError(f"{self.policy} is not one network of discrete actions: name another")
        batch = world.batch(min(self.episodes, SIDE_BY_SIDE))
        blocks = self.seed + np.arange(3 * self.episodes).reshape(3, -1)
        fitted, held_out, fresh = (observations_of(batch, policy, seeds) for seeds in blocks)
        about = {"world": world.description, "episodes": self.episodes, "seed": self.seed}
        policy = replace(policy, provenance={**policy.provenance, "unlikeness": about})
        score = Unlikeness.fit(policy.features(fitted), policy.features(held_out))
        policy = replace(policy, unlikeness=score)
        written: Row = {"out": str(self.out), "sha256": policy.save(self.out, replace=False)}
        for rate in (0.001, 0.01, 0.1):
            written[f"alarms at {rate:g}"] = float(policy.alarm(rate)(fresh).mean())
        return self.show(written, listed(written))


@dataclass(frozen=True)
class Ensemble(Printing):
    """Write the mean of several policies' action values as one policy file.

    The members may have different networks, but must be of one world, and should be trained for one
    angle. The file is accepted wherever a policy is.

    Example: socialiq ensemble 0.safetensors 1.safetensors --out mean.safetensors
    """

    policies: Paths
    """Policy files, of `socialiq train`."""
    out: Path
    """Policy file to write."""

    def run(self) -> int:
        """Read, join and write."""
        if len(self.policies) < 2:
            raise UserError("an ensemble needs policies: name at least two files")
        refuse_existing(self.out)
        policy = EnsemblePolicy.of([load_values(path) for path in self.policies])
        sha256 = policy.save(self.out, replace=False)
        written = {"out": str(self.out), "members": len(policy.members), "sha256": sha256}
        return self.show(written, [written])
