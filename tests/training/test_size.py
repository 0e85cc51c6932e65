"""What is said before anything is compiled: what can't fit into memory is refused, images don't suit the networks."""

import itertools
import time
import warnings

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete

from galton import A2C, UsageError, devices
from galton.algorithms import actor_critic
from galton.envs.find import find
from galton.training import on_device, population, size
from galton.training.population import populate

from ..agents import agent
from ..envs.host.walks import kind

SMALL = {"n_bins": 4, "net_arch": (4,), "n_steps": 5}
PENDULUM = "Pendulum-v1"


@pytest.fixture
def room(monkeypatch):
    """A machine of 8 GB."""
    monkeypatch.setattr(size, "memory", lambda: 8 * 10**9)


TOO_BIG = [
    ({"net_arch": (10**9,)}, 1, 0, r"net_arch is \(1000000000,\)"),
    ({"net_arch": (100_000, 100_000)}, 1, 0, r"net_arch is \(100000, 100000\)"),
    ({"n_envs": 10**9}, 1, 0, "n_envs or n_steps is 1000000000 or 5"),
    ({"n_steps": 10**9}, 1, 0, "n_envs or n_steps is 1 or 1000000000"),
    ({"n_envs": 50_000, "n_steps": 50_000}, 1, 0, "n_envs or n_steps is 50000 or 50000"),
    ({}, 1, 10**10, "n_eval_episodes is 10000000000"),
    ({}, 10**9, 0, "seeds is 1000000000 of them"),
    ({"net_arch": (10_000, 1_000)}, 1_000, 10, "seeds is 1000 of them"),
]


@pytest.mark.usefixtures("room")
@pytest.mark.parametrize("env", ["bandit", "lqr", PENDULUM])
def test_what_is_too_big_is_named(env):
    for changes, n_runs, n_episodes, named in TOO_BIG:
        told = f"^{named}, too many: this needs .* GB of memory at least, and there are 8.0"
        with pytest.raises(UsageError, match=told):
            size.check_size(find(env), agent(SMALL | changes), n_runs, n_episodes)


@pytest.mark.usefixtures("room")
@pytest.mark.parametrize("env", ["bandit", "lqr", PENDULUM])
def test_what_may_fit_is_not_refused(env):
    size.check_size(find(env), agent(SMALL), 1, 10)
    size.check_size(find(env), agent(SMALL | {"net_arch": (1024, 1024)}), 50, 100)
    size.check_size(find(env), agent(SMALL | {"n_envs": 10_000}), 1, 0)
    size.check_size(find(env), agent(SMALL | {"n_steps": 10**6}), 10, 1000)


@pytest.mark.parametrize("env", ["bandit", PENDULUM, lambda: gymnasium.make(PENDULUM)])
def test_models_and_populations_refuse_it_before_they_make_anything(env):
    start = time.monotonic()
    with pytest.raises(UsageError, match="n_envs or n_steps is 100000000000 or 5"):
        A2C(env, n_envs=10**11, n_steps=5)
    with pytest.raises(UsageError, match="seeds is 1000000000000 of them"):
        populate(env, agent(SMALL), range(10**12))
    assert time.monotonic() - start < 60


def test_a_limit_that_is_set_counts(monkeypatch):
    resource = pytest.importorskip("resource")
    machine = devices.memory()
    assert machine > 10**8
    monkeypatch.setattr(resource, "getrlimit", lambda _: (10**7, -1))
    assert devices.memory() == 10**7
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY, -1))
    assert devices.memory() >= machine


def test_what_it_counts_is_what_a_model_has():
    """The parameters and Adam's moments, of a policy that is one number for each action entry."""
    actions, d, o = find("lqr").actions, 2, 2
    made = agent({"loss": "gaussian", "net_arch": (5, 7)}, low=actions.low, high=actions.high)
    params = jax.eval_shape(lambda key: actor_critic.init(key, made, o), jax.random.key(0)).params
    n = sum(array.size for name in ("actor", "critic") for layer in params[name] for array in layer.values())
    counted = [size._n_parameters(made.network, o, outputs, of_critic=outputs == 1) for outputs in (d, 1)]
    assert sum(counted) == n


Seeing = kind("Seeing", observation_space=Dict(eye=Box(0, 255, (4, 4, 3), np.uint8), t=Discrete(4)))
Feeling = kind("Feeling", observation_space=Box(0, 255, (4,), np.uint8))


def stop(*_):
    raise NotImplementedError("what follows is slow")


@pytest.mark.parametrize(
    ("env", "normalize", "is_told"), [(Seeing, False, True), (Seeing, True, False), (Feeling, False, False)]
)
def test_raw_images_are_said_not_to_suit_the_networks(env, normalize, is_told, monkeypatch):
    monkeypatch.setattr(population, "HostPopulation", stop)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        with pytest.raises(NotImplementedError):
            population.populate(env, agent({"normalize_observation": normalize}), [0])
    assert len(told) == is_told
    for warning in told:
        assert str(warning.message).startswith("Seeing observes Dict('eye': Box(0, 255, (4, 4, 3), uint8)")
        assert "Galton has no convolutions" in str(warning.message)
        assert "normalize_observation=True" in str(warning.message)


def test_programs_that_need_more_than_the_device_has_are_refused_with_the_number_that_fits(monkeypatch):
    def compiled(n_envs):
        made = populate("lqr", agent(SMALL | {"n_envs": n_envs}), [0], jax.devices()[:1])
        made.compile()
        return made

    compiled(4000)
    monkeypatch.setattr(size, "device_memory", lambda device: 10**6)
    with pytest.raises(UsageError, match=r"n_envs is 4000 and n_steps 5: training needs 0.0 GB .* fits") as refused:
        compiled(4000)
    fits = int(str(refused.value).partition("n_envs = ")[2].split()[0])
    assert 400 < fits < 4000
    compiled(int(0.95 * fits))  # what does not grow with copies has a share too
    with pytest.raises(UsageError, match="fits"):
        compiled(2 * fits)


@pytest.mark.parametrize("net_arch", [(64, 64), (128, 128), (256, 256, 256), (512, 256, 128)])
def test_a_rollout_takes_the_bytes_that_the_page_of_speed_says(net_arch, monkeypatch):
    """Per copy and step, within a tenth, where there are so many that nothing else counts."""
    told, d = [], 2
    monkeypatch.setattr(on_device, "check_programs", lambda programs, *_: told.extend(programs))
    words = {"loss": "gaussian", "n_envs": 1024, "n_steps": 30, "batch_size": 960, "n_epochs": 4}
    populate("lqr", agent({"algorithm": "ppo", "net_arch": net_arch} | words), [0], jax.devices()[:1]).compile()
    pair = max(below + above for below, above in itertools.pairwise((2, *net_arch)))
    documented = 8 * pair + 4 * (2 * 2 + d + 3)
    assert max(size._bytes(program.memory_analysis()) for program in told) / (1024 * 30) == pytest.approx(
        documented, rel=0.1
    )
