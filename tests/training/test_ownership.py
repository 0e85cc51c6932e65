"""Training owns its environments: nobody moves them unnoticed, evaluation never."""

import copy
import functools
import pickle
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import RescaleAction, TimeLimit
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecMonitor, VecNormalize

import galton
from galton import BrokenEnvironmentError, SharedEnvironment, UsageError
from galton.callbacks import Evaluate

LENGTH = 10


class Clock(gymnasium.Env):
    """Shows how late it is; an episode has LENGTH steps."""

    action_space = Box(-1, 1, (1,))
    observation_space = Box(0, np.inf, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.t += 1
        return np.full(1, self.t, np.float32), float(action[0]), self.t == LENGTH, False, {}


class Own(Clock):
    """Another class with the same spaces."""


make_model = functools.partial(galton.A2C, loss="gaussian", n_steps=2, net_arch=(4,))


def sync():
    return SyncVectorEnv([Clock] * 2, autoreset_mode=AutoresetMode.SAME_STEP)


def asynchronous():
    return AsyncVectorEnv([Clock] * 2, autoreset_mode=AutoresetMode.SAME_STEP, context="spawn")


def dummy():
    return DummyVecEnv([Clock] * 2)


def in_processes():
    return SubprocVecEnv([Clock] * 2, start_method="spawn")


VECTORS = {
    "sync": sync,
    "statistics": lambda: RecordEpisodeStatistics(sync()),
    "dummy": dummy,
    "normalised": lambda: VecNormalize(dummy()),
    "monitored": lambda: VecMonitor(VecNormalize(dummy())),
}
SINGLES = {
    "bare": Clock,
    "monitored": lambda: Monitor(Clock()),
    "wrapped": lambda: Monitor(RescaleAction(TimeLimit(Clock(), 99), np.float32(-2), np.float32(2))),
}


def learn(model, n_steps):
    """Train, and return the lengths of all episodes that ended, by log point."""
    logs = []
    model.learn(n_steps, lambda _, log: logs.append(log), progress_bar=False, log_interval=1)
    return [log["rollout/ep_len_mean"] for log in logs if log["rollout/n_episodes"] > 0]


def bits(model):
    return np.asarray(model.learner.params["critic"][0]["kernel"]).tobytes()


def another(kind):
    """An environment of another class, or one that normalises as the kind does."""
    return VECTORS[kind]() if kind in ("normalised", "monitored") else Own


@pytest.mark.slow
@pytest.mark.parametrize("kind", VECTORS)
@pytest.mark.parametrize("n", [1, 2])
def test_a_vector_environment_is_never_evaluated_on_whatever_the_number_of_episodes(kind, n):
    given = VECTORS[kind]()
    model = make_model(given)
    learn(model, 12)
    with pytest.raises(UsageError, match=r"can't be copied.*evaluate\(env=\.\.\.\) or Evaluate\(env=\.\.\.\)"):
        model.evaluate(n)
    with pytest.raises(UsageError, match=r"can't be copied"):
        model.population.check_evaluation(n)
    with pytest.raises(UsageError, match=r"can't be copied"):
        model.learn(8, Evaluate(every=4, n_episodes=n), progress_bar=False, log_interval=1)
    assert len(model.evaluate(n, env=another(kind))) == n
    assert set(learn(model, 40)) == {LENGTH}


@pytest.mark.few
@pytest.mark.parametrize("kind", VECTORS)
def test_evaluation_on_another_environment_leaves_training_as_it_is(kind):
    models = [make_model(VECTORS[kind]()) for _ in range(2)]
    for model in models:
        learn(model, 12)
    models[0].evaluate(2, env=another(kind))
    models[0].evaluate(2, env=VECTORS[kind]())
    for model in models:
        learn(model, 40)
    assert bits(models[0]) == bits(models[1])


WAYS = {
    "itself": lambda env: env,
    "in a function": lambda env: lambda: env,
    "in a wrapper": lambda env: TimeLimit(env, 50),
    "in a vector": lambda env: DummyVecEnv([lambda: env]),
}


@pytest.mark.slow
@pytest.mark.parametrize("trained", WAYS.values(), ids=WAYS)
@pytest.mark.parametrize("evaluated", WAYS.values(), ids=WAYS)
def test_the_training_environment_given_again_for_evaluation_is_refused(trained, evaluated):
    env = Clock()
    model = make_model(trained(env))
    learn(model, 4)
    with pytest.raises(UsageError, match="is being trained on and can't be copied"):
        model.evaluate(1, env=evaluated(env))
    assert env.t == 4
    model.close()
    assert make_model(Own).evaluate(1, env=env).shape == (1,)  # nobody trains on it any more


def by_evaluate_policy(model, env):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Evaluation environment is not wrapped")
        evaluate_policy(model, env, 2)


def by_reset(model, env):
    env.reset()


def by_a_step(model, env):
    n = getattr(env, "num_envs", None)
    env.step(np.zeros((1,) if n is None else (n, 1), np.float32))


def by_the_innermost(model, env):
    inner = env.unwrapped
    (inner.envs[1].unwrapped if hasattr(inner, "envs") else inner).reset()


def by_another_model(model, env):
    make_model(env).close()


OTHERS = [by_evaluate_policy, by_reset, by_a_step, by_the_innermost, by_another_model]


@pytest.mark.few
@pytest.mark.parametrize("other", OTHERS)
@pytest.mark.parametrize("make", [*SINGLES.values(), *VECTORS.values()], ids=[*SINGLES, *VECTORS])
def test_an_episode_that_somebody_else_moved_begins_anew_and_it_is_said(make, other):
    if other is by_evaluate_policy and isinstance(make(), gymnasium.vector.VectorEnv):
        pytest.skip("SB3 evaluates on its own vector environments only")
    env = make()
    model = make_model(env)
    assert set(learn(model, 6 * model.settings["n_envs"])) == set()
    other(model, env)
    with pytest.warns(SharedEnvironment, match="was reset or stepped by somebody else since training left it"):
        lengths = learn(model, 2 * 14 * model.settings["n_envs"])
    assert set(lengths) == {LENGTH}
    with warnings.catch_warnings():
        warnings.simplefilter("error", SharedEnvironment)
        learn(model, 8)


@pytest.mark.slow
@pytest.mark.parametrize("make", [asynchronous, in_processes])
def test_vector_environments_in_processes_are_watched_too(make):
    env = make()
    model = make_model(env)
    learn(model, 12)
    moves = [lambda: env.env_method("reset")] if make is in_processes else []  # Gymnasium refuses call("reset")
    for move in (env.reset, *moves):
        move()
        with pytest.warns(SharedEnvironment):
            learn(model, 4)
    with pytest.raises(UsageError, match="can't be copied"):
        model.evaluate(2)
    env.close()


def test_an_sb3_evaluation_on_the_training_environment_in_the_middle_of_learn_is_noticed():
    env = Monitor(Clock())
    model = make_model(env)
    with pytest.warns(SharedEnvironment) as told:
        model.learn(60, EvalCallback(env, eval_freq=24, n_eval_episodes=1, verbose=0), progress_bar=False)
    assert len(told) == 2  # after steps 24 and 48
    assert set(learn(model, 40)) == {LENGTH}
    other = make_model(env)
    for each in (model, other):  # they take turns
        with pytest.warns(SharedEnvironment):
            assert set(learn(each, 24)) == {LENGTH}


def test_a_move_in_the_middle_of_a_rollout_stops_training():
    env = Clock()

    class Rude(Own):
        """Resets somebody else's environment."""

        def step(self, action):
            env.reset()
            return super().step(action)

    model = make_model(SyncVectorEnv([lambda: env, Rude], autoreset_mode=AutoresetMode.SAME_STEP))
    learn(model, 4)  # all of it happens inside of our own step
    lone = make_model(env)
    lone.population.compile()
    (group,) = lone.population._groups
    programs = group._acting
    group._acting = copy.copy(programs)
    group._acting.act = lambda *given: (env.reset(), programs.act(*given))[1]
    with pytest.raises(BrokenEnvironmentError, match="Clock was reset or stepped by somebody else in the middle of a"):
        learn(lone, 4)


def test_a_model_saved_after_somebody_moved_its_environment_does_not_claim_to_go_on_exactly(tmp_path):
    class Stateful(Clock):
        def get_state(self):
            return {"t": self.t}

        def set_state(self, state):
            self.t = int(state["t"])

    env = Stateful()
    model = make_model(env)
    learn(model, 6)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        galton.A2C.load(model.save(tmp_path / "own"), env=Stateful)
    env.reset()
    with pytest.warns(galton.InexactResume):
        galton.A2C.load(model.save(tmp_path / "moved"), env=Stateful)


def test_copies_of_a_watched_environment_move_by_themselves():
    env = Monitor(Clock())
    model = make_model(env)
    learn(model, 4)
    for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
        other.reset()
        other.step(np.zeros(1, np.float32))
        assert (other.unwrapped.t, env.unwrapped.t) == (1, 4)
        assert len(model.evaluate(1, env=other)) == 1  # nobody trains on the copy
    learn(model, 4)
