"""Measure how fast Galton trains on a GPU, and how long its programs take to compile there.

Each stage runs in a process of its own, which is ended when its share of the time is over; the next one goes on. Every
row is in the file as soon as it is measured, so the script may be cut at any time. It needs no network.

- `a2c`: populations of 1 to 16,384 runs on the four analytic tasks, App. C.2's settings, k = 100.
- `ppo`: populations under PPO, rollouts of 8 × 256 steps, 5 epochs of minibatches of 64, k = 50.
- `copies`: one run with thousands of copies of an LQR of a cheetah's size (17 states, 6 actions), 128×128 networks.
- `compile`: four runs of 2,048 copies and rollouts of 480 steps, without XLA's autotuning of fusions; and once more
  with it at the end, in all the time that is left.
- `precision`: A2C with matrix products in float32, and in TF32.
- `playground`: PPO with Playground's numbers on CheetahRun and HumanoidWalk, 2,048 and 8,192 copies, and how long the
  physics takes by itself. Only where it is named.
- `brax`: Brax's PPO on the same tasks, by the wall clock, its compilation apart. Only where it is named.
- `heads`: a Gaussian and the discretised Gaussian on one task, 16 draws × 4 seeds as one program of 64 runs × 128
  copies each, for as long as the stage has. Only where it is named, with `--task`.

    python benchmarks/on_gpu.py [--seconds 480] [--toy] [--stages a2c ppo ...] [--out results/benchmarks]
    python benchmarks/on_gpu.py --stages playground brax
    python benchmarks/on_gpu.py --stages heads --task CheetahRun

`--toy` makes sizes small enough for a CPU. Results are named after the device: on_gpu_<device>.json.
"""

import argparse
import datetime
import functools
import json
import math
import os
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

UNTUNED = "--xla_gpu_experimental_enable_fusion_autotuner=false"
TASKS = ("mountain-car", "lqr", "acrobot", "bandit")
STAGES = {
    "a2c": ("", 0.36),
    "compile": (UNTUNED, 0.14),
    "ppo": ("", 0.16),
    "copies": ("", 0.12),
    "precision": ("", 0.06),
    "compile-autotuned": ("", 0.16),
    "playground": (UNTUNED, 0.5),
    "brax": (UNTUNED, 0.5),
    "heads": (UNTUNED, 0.9),
}
"""The flags that XLA gets, and the share of the time. What one leaves over goes to those after it."""
NAMED = ("playground", "brax", "heads")
"""The stages that run only where they are named."""


def a2c(sizes):
    """The largest populations first, then how speed grows with their number, then centred HL-Gauss."""
    largest = sizes[-1]
    for task in TASKS:
        for loss in ("gaussian", "hl-gauss"):
            measure("a2c", task, loss, largest)
    for runs in reversed(sizes[:-1]):
        for loss in ("gaussian", "hl-gauss"):
            measure("a2c", "mountain-car", loss, runs)
    for task in TASKS[:2]:
        measure("a2c", task, "hl-gauss-centred", largest)


def ppo(sizes):
    """From few runs to many, since a rollout of many takes long."""
    settings = {"n_envs": 8, "n_steps": 256, "n_epochs": 5, "n_bins": 50}
    for runs in (sizes[1], sizes[2], sizes[0], sizes[-1]):
        for loss in ("gaussian", "hl-gauss-centred"):
            measure("ppo", "lqr", loss, runs, **settings)
    for loss in ("gaussian", "hl-gauss-centred"):
        measure("ppo", "acrobot", loss, sizes[1], **settings)


def copies(sizes):
    """One run whose minibatches have thousands of steps."""
    for loss in ("gaussian", "hl-gauss-centred"):
        for n_envs in sizes[2:]:
            measure("ppo", cheetah_sized(), loss, 1, **large(n_envs))


def compile_(sizes):
    """Compile alone: nothing is trained."""
    for loss in ("hl-gauss-centred", "gaussian"):
        measure("ppo", cheetah_sized(), loss, sizes[1] // 16 or 1, slices=0, **large(2 * sizes[2], n_steps=480))


def playground(sizes):
    """Playground's tasks, each with fewer and more copies, and the physics alone."""
    from galton.presets import PRESETS

    settings = dict(PRESETS["playground"]["ppo"].settings) | {"resets": "first"}
    for task in ("CheetahRun", "HumanoidWalk"):
        for n_envs in (sizes[1] * 32, sizes[1] * 128):
            own = {"n_envs": n_envs, "batch_size": 15 * n_envs} | ({"n_steps": 30} if sizes[1] == 4 else {})
            measure("ppo", f"playground:{task}", "gaussian", 1, **settings | own)
            print(
                json.dumps({"physics": task, "n_envs": n_envs, "steps_per_second": physics(task, n_envs)}), flush=True
            )


def physics(task, n_envs, n_steps=30):
    """Steps a second of the environment by itself, under random actions."""
    import jax

    from galton.envs import find

    env = find(f"playground:{task}").record

    def stepped(state, key):
        actions = jax.random.uniform(key, (n_envs, len(env.action_low)), minval=-1.0)
        return jax.vmap(lambda state, action: env.step(state, action, ())[0])(state, actions), None

    run = jax.jit(lambda state, key: jax.lax.scan(stepped, state, jax.random.split(key, n_steps))[0])
    state = jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.key(0), n_envs))
    state = jax.block_until_ready(run(state, jax.random.key(1)))
    start = time.perf_counter()
    for i in range(3):
        state = run(state, jax.random.key(i))
    jax.block_until_ready(state)
    return 3 * n_envs * n_steps / (time.perf_counter() - start)


def brax(sizes):
    """Brax's PPO with Playground's numbers; its own count of steps a second is read before the device is done."""
    import jax
    import jax.numpy as jnp

    if not hasattr(jax, "device_put_replicated"):  # which Brax 0.14 asks for, and JAX 0.10 took away
        jax.device_put_replicated = lambda tree, devices: jax.tree.map(
            lambda x: jnp.stack([jnp.asarray(x)] * len(devices)), tree
        )
    from brax.training.agents.ppo import train as ppo
    from mujoco_playground import dm_control_suite, wrapper
    from mujoco_playground.config import dm_control_suite_params

    for task in ("CheetahRun", "HumanoidWalk"):
        told, start = [], time.perf_counter()

        def tell(steps, metrics, told=told, start=start):
            told.append((int(steps), time.perf_counter() - start, float(metrics["eval/episode_reward"])))

        settings = dict(dm_control_suite_params.brax_ppo_config(task, "jax"))
        settings |= {"num_timesteps": 10_000_000, "num_evals": 3}
        if sizes[1] == 4:
            settings |= {"num_timesteps": 4000, "num_envs": 8, "batch_size": 8, "num_minibatches": 2}
            settings |= {"unroll_length": 10, "num_eval_envs": 4, "episode_length": 20, "num_resets_per_eval": 1}
        ppo.train(
            environment=dm_control_suite.load(task, config_overrides={"impl": "jax"}),
            wrap_env_fn=wrapper.wrap_for_brax_training,
            progress_fn=tell,
            **settings,
        )
        steps = (told[-1][0] - told[-2][0]) / (told[-1][1] - told[-2][1])
        row = {"algorithm": "brax's ppo", "env": task, "steps_per_second": steps, "steps, seconds, return": told}
        print(json.dumps(row), flush=True)


def heads(sizes, task, seconds):
    """Two heads on a task, each with half of the time: the returns of all runs, ten times on the way."""
    import jax

    import galton
    from galton.presets import PRESETS
    from galton.training.population import populate

    draws, seeds, n_envs = (2, 2, 4) if sizes[1] == 4 else (16, 4, 128)
    rng = np.random.default_rng(19)
    numbers = {
        "learning_rate": np.exp(rng.uniform(math.log(1e-4), math.log(3e-3), draws)),
        "gamma": 1 - np.exp(rng.uniform(math.log(0.003), math.log(0.03), draws)),
        "ent_coef": np.exp(rng.uniform(math.log(1e-4), math.log(3e-2), draws)),
        "log_std_init": rng.uniform(-2, 0, draws),
    }
    common = dict(PRESETS["playground"]["ppo"].settings) | {"n_envs": n_envs, "n_steps": 60, "n_epochs": 4}
    common |= {name: np.repeat(values, seeds).astype(np.float32) for name, values in numbers.items()}
    common |= {"batch_size": 60 * n_envs // 4, "max_grad_norm": 0.5, "resets": "first", "box_units": 1.0}
    del common["policy"], common["state_dependent_std"]
    bins = {"policy": "discretised-gaussian", "n_bins": 41, "bin_centers": "bounds", "deterministic_action": "mean"}
    for loss, own in (("gaussian", {}), ("hl-one-hot", bins)):
        row = {"task": task, "loss": loss, "draws": draws, "seeds": seeds}
        agent = galton.make_agent(algorithm="ppo", loss=loss, **common | own)
        population = populate(f"playground:{task}", agent, [*range(seeds)] * draws, jax.devices()[:1])
        population.compile()
        begin, n = time.perf_counter(), 1
        for _ in range(10):
            then = time.perf_counter()
            population.advance(n)
            took = time.perf_counter() - then
            returns = population.evaluate(4).mean(1)
            told = {"steps": population.step, "seconds": time.perf_counter() - begin, "returns": returns.tolist()}
            print(json.dumps(row | told), flush=True)
            n = max(1, round(n * seconds / 25 / took))
        population.close()


def precision(sizes):
    """The same population with products of matrices in float32, then in TF32, then as JAX does by default."""
    import jax

    from galton.training.programs import make_room

    for name in ("highest", "tensorfloat32", None):
        jax.config.update("jax_default_matmul_precision", name)
        make_room(share=0)  # the programs of this process don't know of the precision
        measure("a2c", "lqr", "hl-gauss", sizes[-2], precision=str(name))


def large(n_envs, n_steps=30):
    """The settings that PPO has on a GPU: 4 epochs of 32 minibatches."""
    batch_size = max(1, n_envs * n_steps // 32)
    settings = {"n_envs": n_envs, "n_steps": n_steps, "n_epochs": 4, "batch_size": batch_size}
    return settings | {"n_bins": 41, "net_arch": (128, 128)}


def cheetah_sized():
    """An LQR with as many states and actions as HalfCheetah has."""
    from galton.envs.lqr import LQR

    states, actions = 17, 6
    return LQR(0.98 * np.eye(states), 0.1 * np.eye(states, actions), np.eye(states), np.eye(actions))


def measure(algorithm, env, loss, runs, slices=3, precision=None, **settings):
    """Compile, begin and train: one row, printed as a line of JSON."""
    import jax

    import galton
    from galton.training.population import populate

    agent = galton.make_agent(algorithm=algorithm, loss=loss, eta=2.0, **settings)
    row = {"algorithm": algorithm, "env": env if isinstance(env, str) else type(env).__name__.lower() + "-17x6"}
    row |= {"loss": loss, "runs": runs} | settings | ({"precision": precision} if precision else {})
    print(json.dumps({"at": row}), flush=True)
    try:
        start = time.perf_counter()
        population = populate(env, agent, range(runs), jax.devices()[:1])
        population.compile()
        _ = population.learner  # fetched, so what begins the runs is done
        row["compile_seconds"] = population.compile_seconds
        row["begin_seconds"] = time.perf_counter() - start - population.compile_seconds
        if slices:
            row |= speed(population, runs * agent.rollout.size, slices)
        population.close()
    except Exception as error:  # one size too large must not end the others
        row["error"] = f"{type(error).__name__}: {str(error)[:300]}"
    print(json.dumps(row), flush=True)


def speed(population, batch, slices):
    """Environment steps a second in slices of half a second or more, after a first one that is not counted."""
    updates, seconds = 1, 0.0
    while seconds < 0.5:
        updates = max(updates, math.ceil(updates * 0.7 / seconds)) if seconds else 1
        start = time.perf_counter()
        population.advance(updates)
        seconds = time.perf_counter() - start
        if updates == 1 and seconds > 3:
            break
    rates = []
    for _ in range(slices):
        start = time.perf_counter()
        population.advance(updates)
        rates.append(updates * batch / (time.perf_counter() - start))
    return {"steps_per_second": statistics.median(rates), "slices": rates}


def stage(name, toy, task, seconds):
    """Run one stage, in a process of its own."""
    import jax

    device = jax.devices()[0]
    print(json.dumps({"device": device.device_kind, "platform": device.platform, "jax": jax.__version__}), flush=True)
    sizes = (1, 4, 16) if toy else (1, 64, 1024, 4096, 16384)
    if name == "heads":
        heads(sizes, task, seconds)
        return
    stages = {"a2c": a2c, "ppo": ppo, "copies": copies, "precision": precision, "playground": playground, "brax": brax}
    stages.get(name, compile_)(sizes)


def run(name, seconds, toy, task, flags, note):
    """Run a stage for so long at most, and hand on each of its rows."""
    command = [sys.executable, __file__, "--stage", name, *(["--toy"] if toy else [])]
    command += ["--task", task, "--seconds", str(seconds)]
    environment = os.environ | {"XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {flags}".strip()}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    alarms = []
    reader = threading.Thread(target=lambda: alarms.extend(process.stderr), daemon=True)
    reader.start()
    timer = threading.Timer(seconds, process.kill)
    timer.start()
    start, at = time.perf_counter(), None
    for line in process.stdout:
        row = json.loads(line)
        at = row.get("at")
        if at is None:
            note(row)
    status = process.wait()
    timer.cancel()
    reader.join(5)
    ended = {"status": status, "seconds": time.perf_counter() - start} | ({"cut_off_at": at} if at else {})
    slow = [line.strip() for line in alarms if "slow" in line.lower() and "compil" in line.lower()]
    tail = [line.rstrip() for line in alarms[-12:]] if status not in (0, -9) else []
    return ended | ({"slow": slow[:5]} if slow else {}) | ({"last_lines": tail} if tail else {})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=480)
    parser.add_argument("--toy", action="store_true")
    parser.add_argument(
        "--stages", nargs="+", choices=list(STAGES), default=[name for name in STAGES if name not in NAMED]
    )
    parser.add_argument("--task", default="CheetahRun", help="Playground's task on which heads are compared")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    parser.add_argument("--stage", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.stage:
        stage(arguments.stage, arguments.toy, arguments.task, arguments.seconds)
        return

    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    found = {"measured": today, "toy": arguments.toy, "stages": {}}
    arguments.out.mkdir(parents=True, exist_ok=True)

    def note(row, rows):
        if "device" in row:
            found.update(row)
        else:
            rows.append(row)
            shown = {key: f"{value:,.1f}" if isinstance(value, float) else value for key, value in row.items()}
            print({key: value for key, value in shown.items() if key != "slices"}, flush=True)
        save()

    def save():
        name = "".join(c if c.isalnum() else "-" for c in found.get("device", "nothing").lower())
        path = arguments.out / f"on_gpu_{name}.json"
        if path.exists():  # what other calls measured stays
            found["stages"] = json.loads(path.read_text())["stages"] | found["stages"]
        path.with_suffix(".part").write_text(json.dumps(found, indent=1) + "\n")
        path.with_suffix(".part").replace(path)

    end = time.perf_counter() + arguments.seconds
    shares = sum(STAGES[name][1] for name in arguments.stages)
    for name in arguments.stages:
        flags, share = STAGES[name]
        seconds, shares = (end - time.perf_counter()) * share / shares, shares - share
        print(f"{name}: {seconds:.0f} s", flush=True)
        rows = []
        label = f"{name} {arguments.task}" if name == "heads" else name
        found["stages"][label] = {"flags": flags, "rows": rows}
        hand_on = functools.partial(note, rows=rows)
        found["stages"][label] |= run(name, seconds, arguments.toy, arguments.task, flags, hand_on)
        save()


if __name__ == "__main__":
    main()
