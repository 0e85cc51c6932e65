"""How often a sweep compiles."""

import jax
import pytest

from galton_experiments.sweep.executors import Processes, one_per_core
from galton_experiments.sweep.grid import find_grid
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.shard import work
from galton_experiments.sweep.store import Store
from galton_experiments.sweep.study import Study

PROGRAMS = 4
"""Of one structure of agents: begin, train, log, evaluate."""


def count(call):
    """How many programs XLA compiles meanwhile."""
    compiled = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda name, *_, **__: compiled.append(name) if name.endswith("backend_compile_duration") else None
    )
    try:
        call()
    finally:
        jax.monitoring.clear_event_listeners()
    return len(compiled)


@pytest.mark.slow
def test_the_papers_grid_compiles_seven_structures_however_many_shards(tmp_path):
    store = Store(str(tmp_path))
    small = tuple(setting.replace(net_arch=(4,)) for setting in find_grid("paper", "lqr"))
    plan = Plan.create(Study("lqr", small, 2, 40, logs=1, eval_episodes=1), 8)
    plan.save(store)
    assert plan.n_shards == 22
    programs = [setting.program for setting in plan.firsts]
    assert len(set(programs)) == 7
    first = count(lambda: [work(store.url, programs.index(program)) for program in dict.fromkeys(programs)])
    assert first <= 7 * PROGRAMS + 10  # besides, what JAX compiles once per process to place arrays
    assert count(lambda: [work(store.url, index) for index in range(plan.n_shards)]) == 0


def memory(url, index):
    """Of the worker after the shard, in MB."""
    work(url, index)
    with open("/proc/self/statm") as file:  # noqa: PTH123
        return int(file.read().split()[1]) * 4096 / 1e6


@pytest.mark.slow
def test_memory_stays_flat_over_a_thousand_shards(tmp_path):
    store = Store(str(tmp_path))
    setting = find_grid("paper", "bandit")[0]
    plan = Plan.create(Study("bandit", (setting,), 1_000, 50, logs=2, eval_episodes=1), 1)
    plan.save(store)
    assert plan.n_shards == 1_000
    with Processes(one_per_core(1)) as executor:
        sizes = list(executor.map(memory, [store.url] * 1_000, range(1_000)))
    assert max(sizes[900:]) < 1.05 * sizes[99]
