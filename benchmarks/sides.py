"""The benchmarks measure these sides, each in processes of its own, and keep what they found."""

import datetime
import json
import platform
import subprocess
import time
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.spaces import MultiDiscrete

import galton
from galton.devices import n_cores
from galton.saving import provenance
from galton.training.population import populate
from galton_experiments.sweep.executors import Processes

K = 100
_made = {}
"""The side that this process measures."""


def processor():
    """The name of this machine's processor, where the system tells, or else its architecture."""
    cpu = Path("/proc/cpuinfo")
    lines = cpu.read_text().splitlines() if cpu.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


class Discretised(gymnasium.ActionWrapper):
    """Bin indices in, bin centers on."""

    def __init__(self, env, n_bins=K):
        super().__init__(env)
        self.bins = galton.Bins(env.action_space.low, env.action_space.high, n_bins)
        self.action_space = MultiDiscrete([n_bins] * len(self.bins.low))

    def action(self, action):
        return self.bins.centers[np.arange(len(action)), action]


class SB3:
    """One of SB3's models with one torch thread, trained on in slices of `steps`."""

    def __init__(self, task, discrete, steps):
        import torch
        from stable_baselines3 import A2C

        torch.set_num_threads(1)
        env = gymnasium.make(task)
        env = Discretised(env) if discrete else env
        self.model = A2C("MlpPolicy", env, n_steps=20, gae_lambda=1.0, use_rms_prop=False, device="cpu", seed=0)
        self.steps = steps
        self.model.learn(400)

    def advance(self):
        self.model.learn(self.steps)
        return self.steps


class Ours:
    """Runs of ours, trained on in slices of `updates`; each ends at a log point."""

    def __init__(self, task, plain, loss, n_bins, runs, updates):
        env = (lambda: gymnasium.make(task)) if plain else task
        agent = galton.make_agent(loss=loss, n_bins=n_bins)
        self.population = populate(env, agent, range(runs))
        self.runs, self.updates, self.batch = runs, updates, agent.rollout.size
        self.advance()

    def advance(self):
        self.population.advance(self.updates)
        self.population.log()
        return self.updates * self.batch * self.runs


def prepare(kind, *arguments):
    """Make what this process measures."""
    galton.use_all_cores()
    _made["side"] = kind(*arguments)


def measure():
    """Steps per second."""
    start = time.perf_counter()
    return _made["side"].advance() / (time.perf_counter() - start)


class Side:
    """The same thing in each of some processes, which work at the same time."""

    def __init__(self, places, kind, *arguments):
        self.processes, self.n = Processes(places), len(places)
        self._each(prepare, kind, *arguments)

    def steps_per_second(self):
        return sum(self._each(measure))

    def close(self):
        self.processes.shutdown()

    def _each(self, function, *arguments):
        return [future.result() for future in [self.processes.submit(function, *arguments) for _ in range(self.n)]]


class Script:
    """A side in another Python, which answers each line with its steps per second."""

    def __init__(self, python, script):
        self.process = subprocess.Popen(
            [python, script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        answer = self.process.stdout.readline()
        if answer != "ready\n":
            raise RuntimeError(f"{script} in {python} said {answer!r}; `make bench` sets it up")

    def steps_per_second(self):
        self.process.stdin.write("\n")
        return float(self.process.stdout.readline())

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def write(path, packages, **found):
    """A benchmark's numbers with the machine and the versions that they were taken on."""
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    record = {"measured": today, "cores": n_cores(), "machine": processor()}
    record["versions"] = provenance.versions(*packages)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record | found, indent=2) + "\n")
