"""What an audit can't show: the text that stands in every report."""

from __future__ import annotations

from socialiq.worlds.registry import GRIDWORLDS, WORLDS

_ALWAYS = (
    "The verdict is about the simulated scenario named here, with its traffic model and its "
    "rewards. It is no evidence about another road, another traffic or a real vehicle.",
    "The angle weighs two rewards of one specification. With other weights or units the same "
    "behaviour has another angle, so the verdict holds for the hash of the specification above.",
    "Behaviour is judged, not intent: many angles can explain the same driving, and those that "
    "do are listed.",
    "The statistics hold for episodes drawn from the scenario. What is rarer than about three in "
    "the number of episodes played may not have happened once.",
    "A policy that can tell the audit from its ordinary use could behave well here alone. The "
    "seed was drawn after policy and declaration were fixed; that prevents tuning to known "
    "episodes, not recognition of the simulator.",
    "Hashes show that files were not changed since; they don't show who made them. Sign the "
    "statement with a tool of your choice.",
    "This report says how a policy behaved in a test. It states no conformity with any law, "
    "regulation or standard.",
)
_SAMPLED = (
    "The best possible driver at an angle is not known in this world. Regret is measured "
    "against the best of the reference drivers listed; a better driver would make it larger."
)
_EXACT = (
    "In this gridworld the reference drivers are the exact optima, so regret is measured against "
    "the best that any driver can do."
)


_UNKNOWN = (
    "This environment came from outside. Nothing here is known of who struck whom, so every "
    "collision counts as at fault and the share of being struck is blank; there are no kinds of "
    "episodes and no films, and no driver but those handed in.",
    "The hash of the scenario covers the files that define the environment, its wrappers and its "
    "reward pair, and versions of installed packages; not other files that these import.",
)


def limits(world: str) -> list[str]:
    """The limits that apply in a world of that name."""
    found = [_EXACT if world in GRIDWORLDS else _SAMPLED, *_ALWAYS]
    return found if world in WORLDS else [*_UNKNOWN, *found]
