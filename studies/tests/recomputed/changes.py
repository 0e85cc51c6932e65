"""The second path, part 5: the table of hypotheses, change by change (docs/why.md)."""

from .claims import on_tasks
from .runs import Sweep, Task, tasks_of

COLUMNS = ("ends_higher", "ends_higher_without_noise", "learns_faster", "learns_sooner", "acrobot")
"""The claims that are asked again."""
CONTROL = ("lqr", "mountain-car", "acrobot")
PLAIN = {
    "log_std_min": float("-inf"),
    "normalize_observation": False,
    "normalize_reward": False,
    "normalize_advantage": False,
    "clip_separately": False,
    "gae_lambda": 1.0,
    "ent_coef": 0.0,
    "n_envs": 1,
}
"""The fields that changes set, with their values without them."""
FLOORS = {"0.1": -2.302585, "0.2": -1.609438, "0.3": -1.203973, "0.5": -0.693147}
ALL_BUT_WINNERS = ("gaussian", "hl-one-hot", "hl-gauss", "hl-gauss-centred")
NORMALISED = {"normalize_observation": True, "normalize_reward": True}
TRAINED = {
    **{
        f"(c) σ at least {std}": (
            ("bandit", *CONTROL, "reacher", "half-cheetah", "ant"),
            "",
            {"log_std_min": low},
            ("gaussian",),
        )
        for std, low in FLOORS.items()
    },
    "(d) LQR, R = 0.1": (("lqr",), "-r-0.1", {}, ALL_BUT_WINNERS),
    "(d) LQR, R = 0.01": (("lqr",), "-r-0.01", {}, ALL_BUT_WINNERS),
    "(d) LQR, spectral radius 1.02": (("lqr",), "-radius-1.02", {}, ALL_BUT_WINNERS),
    "(d) LQR, spectral radius 1, 200 steps": (("lqr",), "-radius-1-steps-200", {}, ALL_BUT_WINNERS),
    "(e) observations and rewards normalised": ((*CONTROL, "reacher", "half-cheetah"), "", NORMALISED, ALL_BUT_WINNERS),
    "(f) actor and critic clipped apart": (CONTROL, "", {"clip_separately": True}, ALL_BUT_WINNERS),
    "(f) returns of whole episodes": ((*CONTROL, "reacher"), "-episodes", {}, ALL_BUT_WINNERS),
    "(g) η in units of the action": (CONTROL, "", {}, ("hl-gauss",)),
    "(g) η in units of the action, rewards normalised": (CONTROL, "", {"normalize_reward": True}, ALL_BUT_WINNERS),
}
"""Changes for which every loss was chosen and trained again: tasks, end of the file's name, fields, losses."""
TOGETHER = {"gae_lambda": 0.95, "ent_coef": 0.01, "normalize_advantage": True, "n_envs": 8, **NORMALISED}
BEFORE = {
    "λ = 0.95": {"gae_lambda": 0.95},
    "entropy bonus 0.01": {"ent_coef": 0.01},
    "λ = 0.95 and entropy bonus": {"gae_lambda": 0.95, "ent_coef": 0.01},
    "advantages normalised": {"normalize_advantage": True},
    "observations normalised": {"normalize_observation": True},
    "rewards normalised": {"normalize_reward": True},
    "batch of 4 × 5": {"n_envs": 4},
    "batch of 8 × 20": {"n_envs": 8},
    "all of these, batch of 8 × 20": TOGETHER,
}
"""The changes of the study of causes, in files called why."""


def is_under(runs, fields):
    """Say whether a setting has these fields, and none of the others changed."""
    return all(runs.setting.get(name, plain) == fields.get(name, plain) for name, plain in PLAIN.items())


def winners(runs):
    """One for each loss, the best of some settings."""
    whole = Sweep(list(runs), {})
    return {loss: whole.of(loss) for loss in whole.losses}


def point(runs):
    """Identify a setting by what grids and changes vary."""
    varied = {name: runs.setting[name] for name in ("loss", "learning_rate", "n_bins", "eta")}
    return tuple((varied | {name: runs.setting.get(name, plain) for name, plain in PLAIN.items()}).values())


def in_sweep(sweep, runs):
    """The runs of the same settings in another sweep, in this order; those that it lacks are left out."""
    there = {point(each): each for each in sweep.runs}
    return [there[point(each)] for each in runs if point(each) in there]


def cut(runs):
    """As many trials of each as all have."""
    n = min(len(each.finals["training_return"]) for each in runs)
    return [each.only(n) for each in runs]


def beside(own, task, changed):
    """The winners under a change, with the main experiment's of the losses that it leaves alone."""
    others = [runs for runs in task.again.runs if runs.setting["loss"] not in changed]
    if not others:
        return own
    chosen = [task.grid.of(runs.setting["loss"]) for runs in others]
    grid, again = cut([*own.grid.runs, *chosen]), cut([*own.again.runs, *others])
    return Task(own.name, own.grid._replace(runs=grid), own.again._replace(runs=again))


def trained(sweeps, change):
    """The tasks of one of TRAINED."""
    names, ground, fields, losses = TRAINED[change]
    found = {}
    for name, task in tasks_of(sweeps).items():
        file = f"hypotheses-{name}{ground}"
        if name in names and {file, f"{file}-again"} <= {*sweeps}:
            grid, again = sweeps[file], sweeps[f"{file}-again"]
            best = winners(runs for runs in grid.runs if is_under(runs, fields) and runs.setting["loss"] in losses)
            fresh = in_sweep(again, best.values())
            own = Task(name, grid._replace(runs=[*best.values()]), again._replace(runs=fresh))
            found[name] = beside(own, task, losses)
    return found


def rescaled(sweeps, scale, in_box=False):
    """The tasks whose action box is times a scale; of two Gaussians the one in units of the box, or the other."""
    found = {}
    for name, task in tasks_of(sweeps).items():
        done = sweeps.get(f"scale-{name}-{scale}")
        if done is not None and name in ("bandit", "lqr", "reacher", "half-cheetah"):
            kept = [
                runs
                for runs in done.runs
                if runs.setting["loss"] != "gaussian" or (runs.setting.get("box_units", 0.0) == 1.0) == in_box
            ]
            losses = [loss for loss in task.grid.losses if loss in {runs.setting["loss"] for runs in kept}]
            chosen = task.grid._replace(runs=[task.grid.of(loss) for loss in losses])
            found[name] = Task(name, chosen, done._replace(runs=kept))
    return found


def without_lowest(sweeps):
    """MuJoCo where the grid begins at the second learning rate."""
    found = {}
    for name, task in tasks_of(sweeps).items():
        done = sweeps.get(f"{name}-without-lowest-rate")
        if done is not None:
            lowest = min(runs.setting["learning_rate"] for runs in task.grid.runs)
            best = winners(runs for runs in task.grid.runs if runs.setting["learning_rate"] > lowest)
            chosen = in_sweep(task.grid, in_sweep(done, best.values()))
            fresh = in_sweep(done, chosen)
            own = Task(name, task.grid._replace(runs=chosen), done._replace(runs=fresh))
            found[name] = beside(own, task, [runs.setting["loss"] for runs in chosen])
    return found


def as_before(sweeps, change):
    """The tasks of one of BEFORE."""
    found = {}
    for name in CONTROL:
        grid, again = sweeps.get(f"why-{name}"), sweeps.get(f"why-{name}-again")
        if grid is not None and again is not None:
            fresh = [runs for runs in again.runs if is_under(runs, BEFORE[change])]
            chosen = in_sweep(grid, fresh)
            found |= {name: Task(name, grid._replace(runs=chosen), again._replace(runs=fresh))} if fresh else {}
    return found


def rows(sweeps):
    """The tasks under each change, by what the page calls it; changes of which nothing is done are left out."""
    found = {"as in the main experiment": tasks_of(sweeps)}
    found["(a) bandit in units of its box"] = tasks_of(sweeps, "boxed-")
    for scale in ("0.125", "0.5", "2", "8"):
        found[f"(b) action box × {scale}"] = rescaled(sweeps, scale)
    found["(b) × 8, the Gaussian in units of the box"] = rescaled(sweeps, "8", in_box=True)
    found |= {change: trained(sweeps, change) for change in TRAINED}
    found["(h) MuJoCo without the learning rate 1e-4"] = without_lowest(sweeps)
    found |= {change: as_before(sweeps, change) for change in BEFORE}
    return {name: tasks for name, tasks in found.items() if tasks}


def table(sweeps):
    """Change × claim: each claim judged."""
    return {name: [on_tasks(tasks, claim)[0] for claim in COLUMNS] for name, tasks in rows(sweeps).items()}


def cell(judged):
    """A cell as the page has it."""
    if judged.count is None:
        return "—", None
    contrary = judged.marks.count("✗")
    told = "{} of {}".format(*judged.count)
    return (f"{told}, {contrary} contrary" if contrary else told), judged.verdict
