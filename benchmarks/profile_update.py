"""Measure where the time of training goes: each part alone in a loop of its own, on one core, Mountain Car, 16 runs.

The parts are those of one update of 20 steps: the noise, the rollout, and learning, which is the networks' products
forwards and backwards, the losses between them, and Adam with the norm of the gradient. The products alone are timed
too, at the sizes that the update has, to tell arithmetic from the rest. The sum differs from the whole where XLA
merges parts or keeps them apart. Nothing else should be running.

    python benchmarks/profile_update.py [--loss hl-gauss] [--n-bins 100] [--out results/benchmarks]
"""

import argparse
import os
import statistics
import time
from pathlib import Path

import jax
import jax.numpy as jnp
from jax import lax
from rich.console import Console
from rich.table import Table
from sides import write

import galton
from galton.algorithms import actor_critic
from galton.envs.jax_task import JaxTask
from galton.training.on_device import begin_on_device
from galton.training.population import populate
from galton.training.rollout import draw_noise, rollout
from galton.training.run import learn

RUNS, LOOPS, HIDDEN = 16, 200, 64


def microseconds(body, carry, *arguments):
    """Of one call per run, in a loop of one program over all runs; the median of five."""

    def loop(carry, *arguments):
        return lax.fori_loop(0, LOOPS, lambda _, carry: body(carry, *arguments), carry)

    program = jax.jit(jax.vmap(loop))
    jax.block_until_ready(program(carry, *arguments))
    times = []
    for _ in range(5):
        start = time.perf_counter()
        jax.block_until_ready(program(carry, *arguments))
        times.append(time.perf_counter() - start)
    return statistics.median(times) * 1e6 / LOOPS / RUNS


def products(rows, n_outputs):
    """The matrix products of one update, each as (left, right) shapes: [rows, n] times [n, m]."""
    layers = [(2, HIDDEN), (HIDDEN, HIDDEN)]
    actor, critic = [*layers, (HIDDEN, n_outputs)], [*layers, (HIDDEN, 1)]
    forward = [((rows, n), (n, m)) for network in (actor, critic, critic) for n, m in network]
    to_kernels = [((n, rows), (rows, m)) for network in (actor, critic) for n, m in network]
    to_inputs = [((rows, m), (m, n)) for network in (actor, critic) for n, m in network[1:]]
    return forward + to_kernels + to_inputs


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--loss", default="hl-gauss")
    parser.add_argument("--n-bins", type=int, default=100)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {0})
    galton.use_all_cores()

    task = JaxTask(galton.envs.MountainCar())
    one = galton.make_agent(loss=arguments.loss, n_bins=arguments.n_bins, learning_rate=1e-8)
    agents = jax.tree.map(lambda number: jnp.full(RUNS, number), one.on(task.actions.box))
    seeds = jnp.arange(RUNS, dtype=jnp.uint32)
    begin = jax.jit(lambda *runs: lax.map(lambda run: begin_on_device(task, *run), runs))
    state = begin(agents, seeds)

    def draw(key, agent):
        return draw_noise(key, task, agent)

    noise = jax.jit(jax.vmap(draw))(state.run.key, agents)

    def act(episodes, run, noise, agent):
        return rollout(task, agent, run.learner, episodes, noise)

    episodes, _, batch, finished, _ = jax.jit(jax.vmap(act))(state.episodes, state.run, noise, agents)

    def differentiate(params, batch, agent):
        """Networks forwards and backwards, with a gradient of ones in place of the losses'."""

        def outputs(params):
            observation, following = map(actor_critic.flatten, (batch.observation, batch.next_observation))
            values, next_values = (actor_critic.value(agent, params, rows) for rows in (observation, following))
            logits = agent.network(params["actor"], observation)
            return logits.sum() + values.sum() + lax.stop_gradient(next_values).sum()

        gradient = jax.grad(outputs)(params)
        return jax.tree.map(lambda p, g: p + 1e-12 * g, params, gradient)

    def adam(learner, agent):
        """On the parameters themselves as the gradient."""
        params, optimizer, _ = agent.optimizer.step(learner.params, learner.optimizer, learner.params)
        return learner._replace(params=params, optimizer=optimizer)

    whole = populate(task, one, range(RUNS), jax.devices()[:1])
    times = []
    for _ in range(6):  # the first one is not counted
        start = time.perf_counter()
        whole.advance(LOOPS)
        jax.block_until_ready(whole.learner.params)
        middle = time.perf_counter()
        whole.log()
        times.append((middle - start, time.perf_counter() - middle))
    update, log = (statistics.median(column) * 1e6 / RUNS for column in zip(*times[1:], strict=True))
    parts = {"one update, whole": update / LOOPS, "one log point": log}
    parts["noise"] = microseconds(
        lambda total, key, agent: jax.tree.map(
            jnp.add, total, draw(jax.random.fold_in(key, total.action[0, 0, 0] * 1e6), agent)
        ),
        noise,
        state.run.key,
        agents,
    )
    parts["rollout of 20 steps"] = microseconds(
        lambda episodes, *rest: act(episodes, *rest)[0], episodes, state.run, noise, agents
    )
    parts["learning"] = microseconds(
        lambda run, agent, *rest: learn(agent, run, *rest), state.run, agents, batch, finished
    )
    parts["· networks forwards and backwards"] = microseconds(differentiate, state.run.learner.params, batch, agents)
    parts["· Adam and the gradient's norm"] = microseconds(adam, state.run.learner, agents)
    products_alone, operations = 0.0, 0
    n_outputs = 1 if arguments.loss == "gaussian" else arguments.n_bins
    for left, right in products(20, n_outputs):
        a, b = (jax.random.normal(jax.random.key(0), (RUNS, *shape)) for shape in (left, right))
        products_alone += microseconds(lambda a, b: a + 1e-30 * (a @ b).sum(), a, b)
        operations += 2 * left[0] * left[1] * right[1]
    parts["·· its products alone"] = products_alone
    table = Table(
        title=f"Mountain Car, {arguments.loss}, k = {arguments.n_bins}, {RUNS} runs, one core: µs per run and update"
    )
    for heading in ("part", "µs", "of the whole"):
        table.add_column(heading, justify="left" if heading == "part" else "right")
    for name, value in parts.items():
        table.add_row(name, f"{value:.1f}", f"{value / parts['one update, whole']:.0%}")
    console = Console()
    console.print(table)
    speed = operations / products_alone / 1e3
    console.print(f"products alone: {operations / 1e6:.2f} million operations, {speed:.0f} GFLOP/s", highlight=False)
    name = f"profile_{arguments.loss}_{arguments.n_bins}.json"
    write(arguments.out / name, (), microseconds=parts, operations=operations)


if __name__ == "__main__":
    main()
