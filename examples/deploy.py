"""An exported policy swings up a pendulum. This file needs numpy and onnxruntime: no Galton, no JAX, no Gymnasium.

galton train Pendulum-v1 --algorithm ppo --loss gaussian --normalize-observation --steps 100000 --out runs/deploy
galton export runs/deploy --format onnx
python deploy.py runs/deploy
"""

import hashlib
import json
import sys
from pathlib import Path

import numpy as np
import onnxruntime


def load(folder):
    """The policy of a folder as a function from observations [n, ...] to actions [n, ...], and its contract."""
    if not Path(folder, "policy.json").is_file():
        raise SystemExit(f"{folder} is no folder with a policy.json; give the one that `galton export` wrote into")
    contract = json.loads(Path(folder, "policy.json").read_text())
    content = Path(folder, contract["file"]).read_bytes()
    if hashlib.sha256(content).hexdigest() != contract["sha256"]:
        raise SystemExit(f"{contract['file']} is not the file that policy.json describes; export the policy again")
    session = onnxruntime.InferenceSession(content)
    given, taken = contract["input"]["name"], contract["output"]["name"]
    return lambda observations: session.run([taken], {given: observations.astype(np.float32)})[0], contract


def swing_up(act, n_episodes=10, n_steps=200, seed=0):
    """Undiscounted returns [n] of pendulums that begin anywhere, with the physics of Gymnasium's Pendulum-v1."""
    rng = np.random.default_rng(seed)
    angle, speed = rng.uniform(-np.pi, np.pi, n_episodes), rng.uniform(-1, 1, n_episodes)
    returns = np.zeros(n_episodes)
    for _ in range(n_steps):
        torque = act(np.stack([np.cos(angle), np.sin(angle), speed], axis=1))[:, 0]
        off = (angle + np.pi) % (2 * np.pi) - np.pi
        returns -= off**2 + 0.1 * speed**2 + 0.001 * torque**2
        speed = np.clip(speed + 0.05 * (15 * np.sin(angle) + 3 * torque), -8, 8)
        angle = angle + 0.05 * speed
    return returns


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("usage: python deploy.py FOLDER")
    act, contract = load(sys.argv[1])
    source, returns = contract["source"], swing_up(act)
    print(f"{source['algorithm']} with {source['loss']}, {source['steps']:,} steps, rule: {contract['rule']}")
    print(f"return of {len(returns)} swings: {returns.mean():.0f} ± {returns.std():.0f}")
