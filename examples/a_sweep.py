"""A study of your own: two losses, two learning rates, five runs each. Run it again: it knows what it has done."""

from galton_experiments.sweep import Study, expand, sweep, task_defaults

STUDY = Study(
    env="bandit",
    settings=expand([{"loss": ["gaussian", "hl-gauss"], "learning_rate": [0.05, 0.2]}], task_defaults("bandit")),
    trials=5,
    steps=1_000,
    logs=10,
)

if __name__ == "__main__":  # the workers import this file
    table = sweep(STUDY, "runs/a-sweep", shard_width=5)
    names = ["setting.loss", "setting.learning_rate"]
    means = table.group_by(names).aggregate([("final_training_return", "mean")])
    for row in means.to_pylist():
        print(*row.values())
