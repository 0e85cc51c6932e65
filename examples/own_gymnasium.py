"""Your own Gymnasium environment, with the habits of Stable-Baselines3: learn, evaluate, save, load, predict."""

import tempfile
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.spaces import Box

import galton


class Thermostat(gymnasium.Env):
    """Keep a room at 20 °C: heat or cool it by up to 3 °C an hour while the weather drifts."""

    observation_space = Box(-50.0, 80.0, (2,), np.float32)
    action_space = Box(-3.0, 3.0, (1,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.room, self.outside = self.np_random.uniform(10, 30), self.np_random.uniform(-5, 30)
        return self._observe(), {}

    def step(self, action):
        self.outside += self.np_random.normal()
        self.room += float(action[0]) + 0.1 * (self.outside - self.room)
        return self._observe(), -abs(self.room - 20), False, False, {}

    def _observe(self):
        return np.array([self.room, self.outside], np.float32)


if __name__ == "__main__":
    galton.use_all_cores(runs=1)
    model = galton.A2C(
        lambda: gymnasium.wrappers.TimeLimit(Thermostat(), 48),
        loss="hl-gauss-centred",
        eta=1.0,
        n_envs=4,
        normalize_observation=True,
        normalize_reward=True,
        seed=1,
    )
    before = model.evaluate(20).mean()
    model.learn(40_000, callback=galton.callbacks.StopAfter(60))
    print(f"return of 48 hours: {before:.0f} → {model.evaluate(20).mean():.0f}")

    with tempfile.TemporaryDirectory() as folder:
        path = model.save(Path(folder) / "thermostat")
        again = galton.A2C.load(path)  # predicts; with env=... it goes on learning
        action, _ = again.predict(np.array([15.0, 0.0], np.float32), deterministic=True)
        print(f"at 15 °C inside and 0 °C outside: {action[0]:+.1f} °C")
