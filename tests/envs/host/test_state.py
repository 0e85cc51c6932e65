import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit

from galton import BrokenEnvironmentError
from galton.envs.host.gymnasium import GymnasiumTask

from .walks import LENGTH, N, Stateful, Unconvertible, assert_same, play


def test_environments_go_on_exactly_from_their_states():
    task = GymnasiumTask(lambda: TimeLimit(Stateful(), LENGTH - 1))
    envs, others = task.make(N), task.make(N)
    envs.reset(np.arange(N))
    others.reset(np.arange(N) + 50)
    play(envs, 4 * (LENGTH - 1) + 1)
    state = {key: value.copy() for key, value in envs.get_state().items()}
    assert {value.shape[0] for value in state.values()} == {N}
    expected = play(envs, 10, seed=1)
    assert expected[-1].any()
    others.set_state(state)
    assert_same(play(others, 10, seed=1), expected)


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (lambda _: [1], r"get_state returned \[1\], not a dict of arrays"),
        (lambda _: {"a": "text"}, "get_state's 'a' is 'text', not numbers"),
        (lambda _: {"a": Unconvertible()}, "get_state's 'a' is <unconvertible>, not numbers"),
        (lambda self: {"a": np.zeros(int(1e3 * abs(self.position)))}, r"get_state returned .*, but copy 0"),
        (lambda self: 1 / 0, "get_state raised ZeroDivisionError"),
    ],
)
def test_a_broken_state_is_named(state, message):
    class Strange(Stateful):
        get_state = state

    envs = GymnasiumTask(Strange).make(2)
    envs.reset(np.arange(2))
    with pytest.raises(BrokenEnvironmentError, match=rf"^Strange, copy \d, step 0: {message}"):
        envs.get_state()
