import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.wrappers import TimeLimit
from stable_baselines3 import A2C as SB3
from stable_baselines3.common.callbacks import (
    BaseCallback,
    CallbackList,
    CheckpointCallback,
    EvalCallback,
    EveryNTimesteps,
    StopTrainingOnNoModelImprovement,
    StopTrainingOnRewardThreshold,
)
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from galton import A2C, UsageError


class Drift(gymnasium.Env):
    """A deterministic task after a seeded start."""

    action_space = Box(-1.0, 1.0, (2,))
    observation_space = Box(-10.0, 10.0, (2,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x = self.np_random.uniform(-1, 1, 2).astype(np.float32)
        return self.x, {}

    def step(self, action):
        self.x = np.clip(0.9 * self.x + 0.2 * action, -10, 10).astype(np.float32)
        return self.x, -float(self.x @ self.x), False, False, {}


def drift():
    return TimeLimit(Drift(), 15)


class Recorder(BaseCallback):
    """What SB3's loop tells."""

    def __init__(self, stop_at=None):
        super().__init__()
        self.seen, self.stop_at = [], stop_at

    def _on_training_start(self):
        total = self.locals["total_timesteps"]
        self.seen.append(("start", self.num_timesteps, total, self.training_env.num_envs))

    def _on_rollout_start(self):
        self.seen.append(("rollout start", self.num_timesteps))

    def _on_rollout_end(self):
        self.seen.append(("rollout end", self.num_timesteps))

    def _on_training_end(self):
        self.seen.append(("end", self.num_timesteps))

    def _on_step(self):
        self.seen.append(("step", self.n_calls, self.num_timesteps))
        return self.stop_at is None or self.num_timesteps < self.stop_at


@pytest.fixture(scope="module")
def model():
    return A2C(drift, "hl-gauss", n_bins=10, net_arch=(8,), n_steps=4, n_envs=2)


def test_evaluate_policy_equals_our_own_play_of_the_same_episodes(model):
    returns, lengths = evaluate_policy(
        model, make_vec_env(drift, n_envs=1, seed=7), n_eval_episodes=1, return_episode_rewards=True
    )
    env = drift()
    observation, _ = env.reset(seed=7)
    total, length, ended = 0.0, 0, False
    while not ended:
        action, _ = model.predict(observation, deterministic=True)
        observation, reward, terminated, truncated, _ = env.step(action)
        total, length, ended = total + reward, length + 1, terminated or truncated
    assert lengths == [length] == [15]
    np.testing.assert_allclose(returns, [total], rtol=1e-6)


def test_evaluate_policy_runs_on_a_vector_environment_and_without_deterministic_actions(model):
    for deterministic in (True, False):
        mean, std = evaluate_policy(model, make_vec_env(drift, 3), n_eval_episodes=6, deterministic=deterministic)
        assert np.isfinite([mean, std]).all()


@pytest.mark.slow
@pytest.mark.parametrize("stop_at", [None, 12])
def test_callbacks_see_the_steps_that_they_see_in_sb3(stop_at):
    ours, theirs = Recorder(stop_at), Recorder(stop_at)
    model = A2C(drift, "hl-gauss", n_bins=10, net_arch=(8,), n_steps=4, n_envs=2)
    of_sb3 = SB3("MlpPolicy", make_vec_env(drift, 2), n_steps=4, device="cpu")
    for steps in (24, 8) if stop_at is None else (24,):  # SB3 stops within a rollout
        model.learn(steps, ours, progress_bar=False)
        of_sb3.learn(steps, theirs, reset_num_timesteps=False)
    assert ours.seen == theirs.seen
    assert model.num_timesteps == (32 if stop_at is None else 16)


def test_eval_and_checkpoint_callbacks_run_unchanged_and_their_files_load(model, tmp_path):
    first = model.num_timesteps
    evaluation = EvalCallback(
        Monitor(drift()),
        callback_on_new_best=StopTrainingOnRewardThreshold(1e9, verbose=0),
        callback_after_eval=StopTrainingOnNoModelImprovement(100),
        n_eval_episodes=2,
        eval_freq=8,
        log_path=str(tmp_path / "log"),
        best_model_save_path=str(tmp_path / "best"),
        verbose=0,
    )
    checkpoints = CheckpointCallback(8, str(tmp_path / "checkpoints"), name_prefix="m", verbose=0)
    every = EveryNTimesteps(16, CheckpointCallback(1, str(tmp_path / "every")))
    model.learn(48, [CallbackList([evaluation, checkpoints]), every], progress_bar=False)
    assert model.num_timesteps == first + 48
    log = np.load(tmp_path / "log" / "evaluations.npz")
    np.testing.assert_array_equal(log["timesteps"], first + np.array([16, 32, 48]))
    assert log["results"].shape == (3, 2)
    assert (log["ep_lengths"] == 15).all()
    np.testing.assert_allclose(evaluation.best_mean_reward, log["results"].mean(1).max())
    saved = [*(tmp_path / "best").iterdir(), *(tmp_path / "checkpoints").iterdir(), *(tmp_path / "every").iterdir()]
    assert len(saved) == 7
    for path in saved:
        assert A2C.load(path).num_timesteps > first
    assert A2C.load(tmp_path / "best" / "best_model").predict(np.zeros(2))[0].shape == (2,)


def test_ours_and_theirs_run_together_and_one_that_never_stops_does_not_hide_another_that_does(model):
    logs, first = [], model.num_timesteps
    callbacks = [Recorder(), lambda model, log: logs.append(log), Recorder(stop_at=first + 20)]
    model.learn(80, callbacks, progress_bar=False, log_interval=1)
    assert model.num_timesteps == first + 24
    assert len(logs) == 3
    assert len([entry for entry in callbacks[0].seen if entry[0] == "step"]) == 10


class Stages(BaseCallback):
    def _on_step(self):
        self.training_env.set_attr("stage", self.num_timesteps, indices=0)
        self.training_env.env_method("begin", -self.num_timesteps, indices=1)
        return True


def test_a_callback_sets_what_trainings_environments_are_like_as_in_sb3():
    class Staged(Drift):
        stage, begun = 0, ()

        def begin(self, stage):
            self.stage = stage

        def reset(self, **keywords):
            self.begun += (self.stage,)
            return super().reset(**keywords)

    model = A2C(lambda: TimeLimit(Staged(), 4), "gaussian", net_arch=(4,), n_steps=4, n_envs=2)
    model.learn(24, Stages(), progress_bar=False)
    assert model.get_env().get_attr("begun") == [(0, 0, 8, 16), (0, 0, -8, -16)]
    with pytest.raises(AttributeError, match="stage can't be set: a copy of training's environment is no object"):
        A2C("lqr", "gaussian").get_env().set_attr("stage", 1)
    with pytest.raises(AttributeError, match="begin can't be asked for"):
        A2C("lqr", "gaussian").get_env().env_method("begin", 1)


class Reads(BaseCallback):
    def _on_step(self):
        self.seen = self.model.n_envs, self.model.n_steps, self.model.gamma
        return True


def test_a_callback_reads_settings_as_attributes_and_others_are_told_where_they_are(model):
    reads, settings = Reads(), model.settings
    model.learn(8, reads, progress_bar=False)
    assert reads.seen == (settings["n_envs"], settings["n_steps"], settings["gamma"])
    with pytest.raises(AttributeError, match=r"no 'gamma'; model.settings\['gamma'\] is its setting"):
        _ = model.gamma
    with pytest.raises(AttributeError, match="has no attribute 'gammas'"):
        _ = model.gammas


class Slower(BaseCallback):
    def _on_step(self):
        self.model.learning_rate = 1e-5
        return True


def test_a_setting_that_somebody_sets_is_refused_and_not_ignored(model):
    before = model.num_timesteps
    with pytest.raises(UsageError, match=r"learning_rate can't be set: a model keeps its settings, .* a schedule"):
        model.learn(8, Slower(), progress_bar=False)
    with pytest.raises(UsageError, match=r"n_steps can't be set: .*; make another model with it"):
        model.n_steps = 8
    assert model.num_timesteps == before + 8
    model.note = "one of the user's own"


def test_get_env_is_the_vector_environment_that_was_given_or_tells_the_spaces(model, tmp_path):
    given = make_vec_env(drift, 2)
    assert A2C(given, "gaussian", net_arch=(4,)).get_env() is given
    made = model.get_env()
    assert made.num_envs == 2
    assert (made.action_space, made.observation_space) == (Drift.action_space, Drift.observation_space)
    with pytest.raises(UsageError, match=r"get_env\(\) can't be stepped"):
        made.reset()
    assert A2C.load(model.save(tmp_path / "model")).get_env() is None


class Logging(BaseCallback):
    def _on_step(self):
        self.logger.record("mine/step", np.int64(self.num_timesteps))
        self.logger.record("mine/name", "not a number")
        self.logger.record("time/total_timesteps", -1, exclude="tensorboard")
        self.logger.record_mean("mine/mean", float(self.num_timesteps))
        self.logger.record_mean("mine/mean", None)
        for tell in ("debug", "info", "warn", "error"):
            getattr(self.logger, tell)(tell, self.n_calls)
        self.logger.log("logged", self.n_calls)
        self.logger.dump(self.num_timesteps)
        return True


TOLD = [(0, {"warn", "error"}), (1, {"info", "warn", "error", "logged", "step"})]


@pytest.mark.parametrize(("verbose", "told"), TOLD)
def test_what_callbacks_of_sb3_record_is_in_the_log_of_the_next_log_point(verbose, told, capsys):
    logs, model = [], A2C(drift, "hl-gauss", n_bins=10, net_arch=(8,), n_steps=4, n_envs=2, verbose=verbose)
    model.learn(40, [Logging(), lambda model, log: logs.append(log)], progress_bar=False, log_interval=2)
    assert [log["mine/step"] for log in logs] == [log["time/total_timesteps"] for log in logs] == [16, 32, 40]
    means = [np.mean(steps) for steps in (range(2, 17, 2), range(18, 33, 2), range(34, 41, 2))]
    np.testing.assert_allclose([log["mine/mean"] for log in logs], means)
    assert {type(log[name]) for log in logs for name in ("mine/step", "mine/mean")} == {float}
    assert "mine/name" not in logs[0]
    assert {line.split()[0] for line in capsys.readouterr().out.splitlines()} == told


@pytest.mark.slow
def test_an_evaluation_is_normalised_as_training_is_and_its_statistics_are_saved(tmp_path):
    env, test = (VecNormalize(DummyVecEnv([lambda: Monitor(drift())] * n), norm_reward=n == 2) for n in (2, 1))
    test.training = False
    model = A2C(env, "hl-gauss", n_bins=5, net_arch=(4,), n_steps=4)
    callbacks = [
        EvalCallback(test, eval_freq=8, verbose=0),
        CheckpointCallback(8, str(tmp_path), save_vecnormalize=True),
    ]
    model.learn(64, callbacks, progress_bar=False)
    np.testing.assert_array_equal(test.obs_rms.mean, env.obs_rms.mean)
    assert env.obs_rms.count > 60
    assert list(tmp_path.glob("*vecnormalize*.pkl"))
