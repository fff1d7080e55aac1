import numpy as np
import pytest

from socialiq.demonstrations.dataset import Demonstrations
from socialiq.demonstrations.variants import Symmetry, with_images
from socialiq.errors import UserError
from socialiq.types import Ending, RewardPair


def table() -> Demonstrations:
    """Two episodes, of two steps and of one, over three features and three actions."""
    return Demonstrations.of(
        observation=[[1, 2, 3], [4, 5, 6], [7, 8, 9]],
        action=[0, 1, 2],
        next_observation=[[4, 5, 6], [0, 0, 1], [1, 1, 1]],
        ending=[0, Ending.ARRIVAL, Ending.TIMEOUT],
        rewards=RewardPair([1.0, 2.0, 3.0], [0.0, 0.5, 0.25]),
        episode=[0, 0, 1],
        n_actions=3,
    )


def test_images_follow_the_episodes() -> None:
    """The last two features change places, the first its sign, actions 0 and 2 change places."""
    both = with_images(table(), Symmetry((-1, 1, 1), (2, 1, 0), (0, 2, 1)))
    assert both.n_episodes == 4
    np.testing.assert_array_equal(both.observation[:3], table().observation)
    np.testing.assert_array_equal(both.observation[3:], [[-1, 3, 2], [-4, 6, 5], [-7, 9, 8]])
    np.testing.assert_array_equal(both.next_observation[3:], [[-4, 6, 5], [0, 1, 0], [-1, 1, 1]])
    assert both.action.tolist() == [0, 1, 2, 2, 1, 0]
    assert both.episode.tolist() == [0, 0, 1, 2, 2, 3]
    assert both.ending.tolist() == [0, 1, 3, 0, 1, 3]
    np.testing.assert_array_equal(both.totals().env, [3, 3, 3, 3])


def test_an_image_of_an_image_is_the_original() -> None:
    mirror = Symmetry((-1, 1, 1), (2, 1, 0), (0, 2, 1))
    seen = table().observation
    np.testing.assert_array_equal(mirror.image(mirror.image(seen)), seen)


@pytest.mark.parametrize(
    ("signs", "actions", "features"),
    [
        ((1, 1, 1), (1, 2, 0), ()),  # a cycle of three
        ((1, 1, 1), (0, 1, 1), ()),
        ((1, 1, 1), (0, 1, 2), (1, 2, 0)),
        ((-1, 1, 1), (0, 1, 2), (1, 0, 2)),  # signs differ in a pair
        ((2, 1, 1), (0, 1, 2), ()),
        ((1, 1), (0, 1, 2), (0, 2, 1)),
    ],
)
def test_a_map_that_is_not_its_own_inverse_is_refused(signs, actions, features) -> None:
    with pytest.raises(UserError, match="of a symmetry must"):
        Symmetry(signs, actions, features)


def test_a_symmetry_of_another_world_is_refused() -> None:
    with pytest.raises(UserError, match="they belong to another world"):
        with_images(table(), Symmetry((1, -1), (1, 0)))
