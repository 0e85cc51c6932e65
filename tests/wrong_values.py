"""Values of wrong types, as Python and grids in files may bring them: `python tests/wrong_values.py FOLDER`.

A process of its own, for in the tests themselves annotations are checked before Galton sees a value. What is not
refused with the right message is printed.
"""

import math
import re
import sys
import typing
from functools import partial
from pathlib import Path

import numpy as np

from galton import UsageError
from galton.agents import read
from galton.algorithms import Rollout
from galton.parts import settings
from galton.words import CHOICES, CHOOSING, vocabulary
from galton_experiments.sweep.grid import read_grid
from galton_experiments.sweep.study import Setting

KNOWN = vocabulary()
NUMBERS = [name for name in KNOWN.usual if KNOWN.is_number(name)]
FLAGS = [name for name, kind in KNOWN.annotations.items() if kind is bool]
WORDS = [name for name, kind in KNOWN.annotations.items() if typing.get_origin(kind) is typing.Literal]
NAMES = ["ordered", "per_entry"]
LISTS = ["net_arch", "critic_arch"]
COUNTS = [name for name in KNOWN.annotations if name not in (*NUMBERS, *FLAGS, *WORDS, *LISTS, *NAMES)]
MAY_BE_NONE = (
    *("box_units", "ent_coef", "noise_correlation", "head_scale", "diffusion", "clip_range_vf", "normalize_window"),
)
"""Numbers that an agent may have as None, which programs lack; a setting of a sweep may not."""
WRONG = {
    "flag": (
        [*FLAGS, "entropy_target"],
        ["false", "no", "", None, 0, 1, 2.5, np.int64(1), np.ones(1, bool), [True], math.nan],
    ),
    "count": (COUNTS, ["20", 2.0, math.nan, None, True, np.True_, 0, -1, [20], np.ones(1, int), 1j]),
    "word": (WORDS, [None, 0, True, "", "none", b"mean", ["mean"], ("auto",), {}]),
    "name": (sorted({*CHOOSING} - {"entropy_target"}), [None, 0, True, b"a2c", ["a2c"], {"a2c"}]),
    "tuple": (LISTS, [None, 8, "88", b"88", {8}, {8: 8}, [8.0], ["8"], [True], [0], [[8]], np.array(8)]),
    "names": (NAMES, [None, 8, "gear", b"gear", {"gear"}, [None], [8.0], [b"gear"], [["gear"]]]),
    "number": (NUMBERS, ["0.5", None, True, np.True_, b"1", 1j, {}, math.nan, [[1], [1, 2]], ["0.5"]]),
}
LINES = [
    ('normalize_observation = "false"', "normalize_observation is 'false'; it must be True or False"),
    ("normalize_observation = 1", "normalize_observation is 1; it must be True or False"),
    ("normalize_reward = [true, 0]", "normalize_reward is 0; it must be True or False"),
    ('n_bins = "50"', "n_bins is '50'; it must be an integer of at least 2"),
    ("n_bins = 50.0", "n_bins is 50.0; it must be an integer of at least 2"),
    ("n_steps = 2024-01-01", "n_steps is datetime.date"),
    ("net_arch = 64", "net_arch is 64; it must be a list or a tuple"),
    ("net_arch = [64, [32]]", "an entry of net_arch is"),
    ("loss = [['gaussian']]", "loss is ['gaussian']; choose from gaussian, hl-one-hot"),
    ("bin_sample = [['center']]", "bin_sample is ['center']; choose from center, uniform"),
    ('eta = "0.5"', "eta is '0.5'; it must be a number"),
    ("eta = true", "eta is True; it must be a number"),
    ("eta = nan", "eta is nan; it must be finite, and greater than 0"),
    ("learn_rate = 0.5", "'learn_rate' is no setting"),
]
"""Lines of a grid, and what is said of each."""


def owners(name):
    """The kinds of parts that have a setting of that name."""
    kinds = (kind for choice in CHOICES.values() for kind in choice.registry.values())
    return [kind for kind in (*kinds, Rollout) if name in settings(kind)]


def attempts(folder):
    """What to try, by its name, and what must be said of it."""
    for names, values in WRONG.values():
        for name in names:
            for value in values:
                said = rf"(an entry of )?{name} is .*; (it must be|choose from|give one)"
                if value is None and name == "critic_arch":  # the usual value
                    continue
                if not (value is None and name in MAY_BE_NONE):
                    yield f"words {name} {value!r}", said, partial(read, {name: value})
                    for kind in owners(name)[:1]:
                        yield f"{kind.__name__} {name} {value!r}", said, partial(kind, **{name: value})
                yield f"Setting {name} {value!r}", said, partial(Setting, {name: value})
    path = folder / "grid.toml"
    for line, said in LINES:
        path.write_text(f"[[grid]]\n{line}\n")
        yield line, re.escape(f"grid is {str(path)!r}: {said}"), partial(read_grid, path, {})


def main(folder):
    n = 0
    for what, said, attempt in attempts(Path(folder)):
        n += 1
        try:
            attempt()
            print(f"{what} passed")
        except UsageError as error:
            if not re.match(said, " ".join(str(error).split())):
                print(f"{what}: {error}")
        except Exception as error:
            print(f"{what}: {error!r}")
    print(n)


if __name__ == "__main__":
    main(*sys.argv[1:])
