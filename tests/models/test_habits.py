"""What users of Stable-Baselines3 expect of a model, beside learn, predict, save and load."""

import copy
import functools
import gc
import inspect
import math
import os
import pickle
import signal
import warnings

import jax
import numpy as np
import pytest
from gymnasium.wrappers import NormalizeObservation, RecordEpisodeStatistics

from galton import A2C, PPO, InexactResume, UsageError
from galton.callbacks import Print
from galton.models.learning import compiling

from ..envs.host.walks import Closing
from ..swing import stateful_swing, swing

SMALL = {"preset": "paper", "n_bins": 10, "net_arch": (8,), "n_steps": 5, "n_envs": 2}
QUIET = {"progress_bar": False}
NORMALISING = {"normalize_observation": True, "normalize_reward": True}
made = functools.partial(A2C, **SMALL)


def same(one, other):
    return all((a == b).all() for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True))


HINTS = {
    "policy_kwargs": "net_arch=\\(64, 64\\)",
    "tensorboard_log": "TensorBoard",
    "device": "JAX_PLATFORMS",
    "use_sde": "no state-dependent exploration",
    "use_rms_prop": "Adam",
    "clip_range_vf": "PPO alone clips",
    "n_timestep": "it takes .*learning_rate",
}


def test_an_argument_of_theirs_gets_a_hint(tmp_path):
    for model, policy in ((A2C, "MlpPolicy"), (PPO, "CnnPolicy"), (A2C, "MultiInputPolicy")):
        with pytest.raises(UsageError, match=rf"env is '{policy}'.*{model.__name__}\('Pendulum-v1', ...\) is enough"):
            model(policy, "Pendulum-v1")
    for argument, remedy in HINTS.items():
        with pytest.raises(TypeError, match=f"A2C.*{argument}.*{remedy}"):
            A2C("bandit", **{argument: None})
    model = made("bandit")
    for argument in ("reset_num_timesteps", "tb_log_name", "eval_env", "wrong"):
        with pytest.raises(TypeError, match=f"learn.*{argument}"):
            model.learn(10, **{argument: True}, **QUIET)
    assert model.num_timesteps == 0
    with pytest.raises(TypeError, match=r"load\(\) got an unexpected keyword argument 'device'; JAX chooses"):
        A2C.load(tmp_path / "nothing", device="cpu")
    with pytest.raises(TypeError, match=r"'learning_rate'; a model keeps its settings"):
        A2C.load(tmp_path / "nothing", learning_rate=1e-5)


def test_a_number_of_steps_may_be_a_whole_float_and_is_rounded_up_to_updates():
    for steps in (1e2, 100, np.float64(100)):
        model = made("bandit").learn(steps, **QUIET)
        assert model.num_timesteps == 100
    for steps in (1.5, math.nan, math.inf, 0.0, -1e2, 1e12):
        with pytest.raises(UsageError, match="total_timesteps is"):
            model.learn(steps, **QUIET)
    assert model.num_timesteps == 100
    with pytest.warns(UserWarning, match="is 7, .* takes n_steps · n_envs = 5 · 2 = 10 steps, so 10 are taken"):
        model.learn(7, **QUIET)
    assert model.num_timesteps == 110
    assert model.learn(11, **QUIET).num_timesteps == 130


def test_the_log_has_the_learning_rate_in_force_and_one_that_is_0_is_told():
    rates = []
    model = made("bandit", learning_rate=0.1, decay_steps=40)
    for _ in range(2):
        model.learn(20, lambda model, log: rates.append(log["train/learning_rate"]), 1, **QUIET)
    np.testing.assert_allclose(rates, [0.075, 0.05, 0.025, 0.0], rtol=1e-6)
    with pytest.warns(UserWarning, match=r"decay_steps is 40, and the learning rate is 0 from there on"):
        model.learn(20, **QUIET)
    fixed = made("bandit", learning_rate=0.1)
    fixed.learn(10, lambda _, log: rates.append(log["train/learning_rate"]), **QUIET)
    assert rates[-1] == np.float32(0.1)


def test_a_learning_rate_that_is_0_is_told_before_training():
    for name, value in (("learning_rate", 1e-50), ("decay_steps", 5), ("decay_steps", 20)):
        model = made("bandit", **{name: value})
        before = model.get_parameters()
        with pytest.warns(UserWarning, match=f"{name} is .*nothing (more )?is learnt"):
            model.learn(30, **QUIET)
        assert same(before, model.get_parameters()) == (value != 20)


@pytest.mark.slow
def test_the_log_says_how_many_minibatches_the_target_kl_let_through():
    counts = []
    for target_kl in (None, 1e-12):
        model = PPO("lqr", **SMALL, batch_size=5, n_epochs=3, target_kl=target_kl, learning_rate=0.1)
        model.learn(10, lambda _, log: counts.append(log["train/n_minibatches"]), **QUIET)
    assert counts == [3 * 2, 1]


@pytest.mark.slow
def test_a_model_says_what_it_is_and_only_what_is_unusual():
    model = made("lqr", "hl-one-hot", seed=3, learning_rate=0.01).learn(50, **QUIET)
    assert repr(model) == (
        "<galton.A2C: hl-one-hot on LQR, n_envs=2, n_bins=10, n_steps=5, net_arch=(8,), learning_rate=0.01, seed=3, "
        "50 steps>"
    )
    assert repr(PPO("lqr", "hl-gauss")) == "<galton.PPO: hl-gauss on LQR, n_envs=1, seed=0, 0 steps>"


def test_verbose_prints_a_line_at_each_log_point_and_nothing_is_drawn_without_a_terminal(capsys, monkeypatch):
    monkeypatch.setattr("rich.console.Console.is_terminal", False)
    made("bandit", verbose=1).learn(50, log_interval=2, **QUIET)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["step 20", "step 40", "step 50"]
    assert all("ep_rew_mean" in line and "fps" in line for line in lines)
    with pytest.raises(UsageError, match="log_interval is True"):
        made("bandit").learn(10, None, True, **QUIET)
    model = made("bandit").learn(1010, log_interval=2)
    assert capsys.readouterr().out == ""
    Print()(model, {"rollout/ep_rew_mean": math.nan, "eval/mean_reward": -2.5})
    assert capsys.readouterr().out == "step 1,010: mean_reward -2.5\n"


class Waited:
    """A timer whose seconds have passed at once."""

    def __init__(self, _, call):
        self.start, self.cancel, self.join = call, bool, bool


@pytest.mark.parametrize(("terminal", "printed", "said"), [(True, False, 1), (False, True, 1), (False, False, 0)])
def test_compiling_that_takes_long_is_said_on_a_terminal_or_in_a_line(terminal, printed, said, monkeypatch, capsys):
    monkeypatch.setattr("galton.models.learning.threading.Timer", Waited)
    monkeypatch.setattr("rich.console.Console.is_terminal", terminal)
    with compiling(printed):
        pass
    out, err = capsys.readouterr()
    assert (out, err.count("compiling") > 0) == ("", said)
    assert terminal or err == "compiling\n" * said


@pytest.mark.few
@pytest.mark.parametrize("env", ["bandit", swing, stateful_swing], ids=["jax", "no state", "state"])
def test_a_model_loaded_without_an_environment_can_be_saved_to_the_same_bytes(env, tmp_path):
    path = made(env).learn(50, **QUIET).save(tmp_path / "one")
    loaded = A2C.load(path)
    assert loaded.save(tmp_path / "other").read_bytes() == path.read_bytes()
    assert "swing" in repr(loaded) or "Bandit" in repr(loaded)
    loaded.close()


def test_load_on_a_model_is_refused_with_what_to_write(tmp_path):
    model = made("bandit")
    path = model.save(tmp_path / "model")
    with pytest.raises(UsageError, match=r"A2C.load makes a new model .*; write model = A2C.load\(path\)"):
        model.load(path, env="bandit")
    assert type(model).load(path).num_timesteps == 0
    assert inspect.signature(PPO.load) == inspect.signature(A2C.load)
    assert "path" in inspect.signature(A2C.load).parameters


def test_pickle_and_deep_copy_of_a_model_name_what_to_do_instead():
    model = made("bandit")
    for taking in (pickle.dumps, copy.deepcopy):
        with pytest.raises(TypeError, match=r"A2C can't be pickled or copied.*save\(path\).*A2C.load\(path, env\)"):
            taking(model)
    assert copy.copy(model).population is model.population


@pytest.mark.slow
def test_environments_that_a_model_made_are_closed_with_it_and_one_that_was_given_is_not():
    made, given = [], Closing()

    def make():
        made.append(Closing())
        return made[-1]

    for env, n_envs in ((make, 2), (given, 1)):
        model = A2C(env, **SMALL | {"n_envs": n_envs}).learn(10, **QUIET)
        del model
        gc.collect()
    A2C(make, **SMALL).close()
    gc.collect()
    assert [env.closed for env in made] == [1] * 4
    assert given.closed == 0


@pytest.mark.parametrize("child", ["learn", "evaluate", "new"])
def test_training_in_a_forked_child_says_what_to_do_instead(child):
    model = made("bandit")
    calls = {"learn": lambda: model.learn(10, **QUIET), "evaluate": model.evaluate, "new": lambda: made("lqr")}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of JAX's and of Python's, that it may hang
        pid = os.fork()
    if not pid:
        signal.alarm(20)
        try:
            calls[child]()
        except UsageError as error:
            os._exit('get_context("spawn")' not in str(error))
        finally:
            os._exit(2)
    assert os.waitpid(pid, 0)[1] == 0


def test_without_an_environment_it_says_how_to_give_one(tmp_path):
    model = A2C.load(made("bandit").save(tmp_path / "model"))
    for method in ("learn", "evaluate", "advance", "set_parameters", "set_random_seed"):
        argument = {"set_parameters": model.get_parameters()}.get(method, 10)
        with pytest.raises(UsageError, match=r"load\(path, env=...\), or set_env\(env\)"):
            getattr(model, method)(argument)


def test_parameters_are_copies_and_can_be_put_into_another_model():
    one, other = made("bandit").learn(50, **QUIET), made("bandit", seed=1)
    got = one.get_parameters()
    assert same(got, one.learner.params)
    other.set_parameters(got)
    observation = np.ones(1, np.float32)
    action, before = (model.predict(observation, deterministic=True)[0] for model in (other, one))
    np.testing.assert_array_equal(action, before)
    got["actor"][0]["kernel"][:] = 0.0
    assert not same(got, one.learner.params)
    other.learn(50, **QUIET)
    assert not same(one.learner.params, other.learner.params)


@pytest.mark.slow
@pytest.mark.parametrize("env", ["lqr", swing], ids=["jax", "gymnasium"])
def test_parameters_carry_the_statistics_that_normalise(env):
    one, other = made(env, **NORMALISING).learn(50, **QUIET), made(env, **NORMALISING, seed=1)
    got = one.get_parameters()
    assert got["normalizer"]["observation"]["n"] > 50
    other.set_parameters(got)
    observation = np.full(2, 0.3, np.float32)
    action, before = (model.predict(observation, deterministic=True)[0] for model in (other, one))
    np.testing.assert_array_equal(action, before)
    assert same(other.get_parameters(), got)
    del got["normalizer"]
    with pytest.warns(UserWarning, match="parameters has no normalizer.*; give what get_parameters"):
        other.set_parameters(jax.tree.map(np.zeros_like, got))
    assert same(other.get_parameters()["normalizer"], one.get_parameters()["normalizer"])
    negative = one.get_parameters()
    negative["normalizer"]["observation"]["variance"] -= 1e6
    with pytest.raises(UsageError, match=r"parameters\['normalizer'\]\['observation'\]\['variance'\] is negative"):
        other.set_parameters(negative)
    for model in (one, other):
        model.close()
    with pytest.raises(UsageError, match=r"differ from the model's own in \['normalizer'\]"):
        made("lqr").set_parameters(negative)


def test_other_parameters_are_refused_and_nothing_is_changed():
    model = made("bandit")
    before = model.get_parameters()
    for change, message in (
        (lambda p: p | {"log_std": np.zeros(2)}, "differ from the model's own in .*log_std"),
        (lambda p: {"actor": p["actor"]}, "differ from the model's own in .*critic"),
        (lambda p: jax.tree.map(lambda x: x[..., None], p), "has shape"),
        (lambda p: jax.tree.map(lambda x: x * np.nan, p), "not all finite"),
        (lambda p: jax.tree.map(lambda x: "a", p), "has shape|not all finite"),
        (lambda p: jax.tree.map(lambda x: np.full(x.shape, 1e300), p), "not all finite numbers of float32"),
        (lambda p: {}, "differ"),
    ):
        with pytest.raises(UsageError, match=message):
            model.set_parameters(change(model.get_parameters()))
        assert same(before, model.get_parameters())


@pytest.mark.parametrize(("env", "more"), [("bandit", {}), (stateful_swing, NORMALISING)], ids=["jax", "gymnasium"])
def test_another_random_seed_changes_what_follows_and_the_same_repeats_it(env, more):
    def after(*seeds):
        model = made(env, **more).learn(50, **QUIET)
        for seed in seeds:
            model.set_random_seed(seed)
        params = model.learn(50, **QUIET).get_parameters()
        model.close()
        return params

    assert same(after(7), after(3, 7))
    assert not same(after(7), after())
    with pytest.raises(UsageError, match="seed is -1"):
        made("bandit").set_random_seed(-1)


def test_set_env_goes_on_with_what_was_learnt_on_another_environment(tmp_path):
    model = made(swing, **NORMALISING).learn(50, **QUIET)
    before, path = model.get_parameters(), model.save(tmp_path / "model")
    assert np.any(model.learner.normalizer.running_return)
    model.set_env(stateful_swing)
    assert not np.any(model.learner.normalizer.running_return), "as those of SB3's VecNormalize at a reset"
    loaded = A2C.load(path)
    loaded.set_env(swing)
    for each in (model, loaded):
        assert each.num_timesteps == 50
        assert all(same(before[name], each.get_parameters()[name]) for name in ("actor", "critic"))
        assert each.learn(50, **QUIET).num_timesteps == 100
        each.close()


@pytest.mark.parametrize("bare", [swing, stateful_swing])
def test_set_env_keeps_what_the_wrappers_have_counted(bare):
    def make():
        return NormalizeObservation(bare())

    model = A2C(make, **SMALL | {"n_envs": 1}).learn(50, **QUIET)
    model.set_env(make)
    snapshot = model.population.snapshot()
    count = next(value for name, value in snapshot["statistics"].items() if name.endswith("count"))
    assert count.item() > 50


def test_set_env_tells_of_statistics_that_other_wrappers_lose():
    def normalised():
        return NormalizeObservation(swing())

    model = A2C(normalised, **SMALL | {"n_envs": 1}).learn(50, **QUIET)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.set_env(lambda: RecordEpisodeStatistics(normalised()))
    with pytest.warns(UserWarning, match="the statistics of NormalizeObservation are lost; wrap both alike"):
        model.set_env(swing)
    with pytest.warns(UserWarning, match="there are no statistics for NormalizeObservation; wrap both alike"):
        model.set_env(normalised)


def test_set_env_refuses_other_spaces_and_keeps_the_environment():
    model = made("bandit")
    with pytest.raises(UsageError, match=r"env has (actions|observations)"):
        model.set_env("mountain-car")
    with pytest.raises(UsageError, match="n_envs is 2, but one environment was given"):
        model.set_env(swing())
    assert model.learn(10, **QUIET).num_timesteps == 10


@pytest.mark.slow
def test_a_model_whose_environment_was_closed_is_saved_without_it(tmp_path):
    env = stateful_swing()
    model = A2C(env, **SMALL | {"n_envs": 1}).learn(50, **QUIET)
    env.unwrapped.get_state = lambda: 1 / 0
    with pytest.warns(UserWarning, match="ZeroDivisionError.*goes on in new episodes"):
        path = model.save(tmp_path / "model")
    with pytest.warns(InexactResume):
        A2C.load(path, stateful_swing).close()
