"""What counts as a move of an environment, and that counting them leaves the environment as it is."""

import functools

import pytest
from gymnasium.wrappers import TimeLimit

from galton.envs.find import find
from galton.envs.host.moves import Watch, moves_of

from .walks import Walk


class Remote(Walk):
    """Copies in another process, as far as one sees of them from here."""

    def env_method(self, name, *arguments):
        return None

    def step_async(self, actions):
        pass

    def set_state(self, state):
        pass


@pytest.mark.parametrize(
    ("move", "counts"),
    [
        (lambda env: env.env_method("reset"), True),
        (lambda env: env.env_method("step", [0.0]), True),
        (lambda env: env.step_async([0.0]), True),
        (lambda env: env.set_state({}), True),
        (lambda env: TimeLimit(env, 5).reset(), True),
        (lambda env: env.env_method("set_difficulty", 5), False),
        (lambda env: env.render_mode, False),
    ],
)
def test_moves_are_what_resets_or_steps_by_whatever_way(move, counts):
    env = Remote()
    env.reset = functools.partial(env.reset)  # a method without a name is counted too
    env.reset()
    watch = Watch(moves_of([env]))
    watch.begin()
    move(env)
    assert watch.others_moved() == counts
    watch.renew()
    assert not watch.others_moved()


def test_watching_again_and_again_adds_no_layers():
    env = Walk()
    for _ in range(5):
        find(env).make(1)
    assert vars(env)["step"].method.__func__ is Walk.step
    first, second = moves_of([env]), moves_of([TimeLimit(env, 5)])
    assert first == second


def test_an_environment_is_training_s_until_the_watch_ends_or_is_gone():
    (moves,) = both = moves_of([Walk()])
    watch, other = Watch(both), Watch(both)
    assert not moves.are_watched
    watch.begin()
    other.begin()
    watch.end()
    assert moves.are_watched
    del other
    assert not moves.are_watched


def test_what_galton_makes_of_an_id_is_not_watched():
    envs = find("MountainCarContinuous-v0").make(2)
    assert envs.moves == ()
    assert not {"reset", "step"} & set(vars(envs._envs[0].unwrapped))
