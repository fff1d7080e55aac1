"""Atlas: trained intersection policies shipped with the package, and how each was made.

They are stored with the committed results of the studies that made them.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from socialiq.errors import UserError, one_of
from socialiq.nn.actor_policy import ActorPolicy
from socialiq.nn.ensemble import EnsemblePolicy, load_values
from socialiq.nn.q_policy import QPolicy
from socialiq.storage import packaged_results, read_json
from socialiq.worlds.intersection.options import Options

FOLDER = "atlas"
MANIFEST = "manifest.json"
# Studies whose results contain policies of the atlas, of discrete and of continuous actions.
STUDIES = ("intersection", "intersection-networks", "intersection-policy-iteration")
CONTINUOUS_STUDIES = ("intersection-continuous",)


def manifest(studies: tuple[str, ...] = STUDIES) -> dict[str, Any]:
    """Return every policy by name: file, SHA-256, provenance, measured behaviour."""
    return {name: entry for _, policies in _parts(studies) for name, entry in policies.items()}


def names(studies: tuple[str, ...] = STUDIES) -> tuple[str, ...]:
    """Return the names of the policies; empty if the package was installed without the atlas."""
    try:
        return tuple(manifest(studies))
    except UserError:
        return ()


def load(name: str) -> QPolicy | EnsemblePolicy:
    """Load a policy of the atlas, of discrete actions.

    Raises:
        UserError: If the name is unknown, or the file's SHA-256 differs from the manifest's.
    """
    return _checked(load_values, name, STUDIES)


def load_continuous(name: str) -> ActorPolicy:
    """Load a policy of the atlas with continuous actions; it raises what `load` raises."""
    return _checked(ActorPolicy.load, name, CONTINUOUS_STUDIES)


def _checked(read: Callable[[Path], Any], name: str, studies: tuple[str, ...]) -> Any:
    path = path_of(name, studies)
    loaded = read(path)
    if loaded.sha256 != manifest(studies)[name]["sha256"]:
        raise UserError(f"{path} is not the file of its manifest: install the package again")
    return loaded


def path_of(name: str, studies: tuple[str, ...] = STUDIES) -> Path:
    """Return the path of a policy's file.

    Args:
        name: Name of the policy.
        studies: Studies in whose results it is searched for.

    Raises:
        UserError: If none of them has a policy of this name.
    """
    one_of("policy of the atlas", name, names(studies))
    folder, policies = next(entry for entry in _parts(studies) if name in entry[1])
    return folder / policies[name]["file"]


def studies_of(action_size: int) -> tuple[str, ...]:
    """Return the studies whose policies have actions of a length, 0 for discrete ones."""
    return CONTINUOUS_STUDIES if action_size else STUDIES


def path_for(name: str, options: Options) -> Path:
    """Return the path of a policy's file, for the kind of actions of a scenario.

    Args:
        name: Name of the policy.
        options: Options of the scenario.

    Raises:
        UserError: If the name is unknown for this kind of actions, or the scenario's ego steers: no
            policy of the atlas does.
    """
    path = path_of(name, CONTINUOUS_STUDIES if options.continuous else STUDIES)
    if options.width == 2:
        raise UserError(
            f"atlas:{name} accelerates and doesn't steer: name a rule or a policy file that was "
            "trained with steering"
        )
    return path


def _parts(studies: tuple[str, ...]) -> list[tuple[Path, dict[str, Any]]]:
    """Return each study's folder of policies and their manifest entries."""
    folders = [packaged_results() / study / FOLDER for study in studies]
    folders = [folder for folder in folders if folder.is_dir()] or folders[:1]
    return [(folder, read_json(folder / MANIFEST)["policies"]) for folder in folders]
