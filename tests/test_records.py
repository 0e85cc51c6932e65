"""A record may grow: names, seeds and files stay what they are, and what a newer version wrote is called newer.

A copy of the source gets two settings of a part that every agent has, something more that algorithms tell, and more in
the diagnosis, as somebody would add them, and both versions write the same things (tests/writer.py).
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from safetensors import safe_open
from safetensors.numpy import load_file

import galton
from galton import A2C, PPO, CheckpointError, NewerVersionError
from galton.saving import checkpoint
from galton_experiments.sweep.plan import Plan
from galton_experiments.sweep.results import same_columns
from galton_experiments.sweep.store import Store

HERE = Path(__file__).parent
FIELDS = {"newer_choice": '"other"', "newer_number": "2.5"}
"""What the grown version knows besides, with values that are not the defaults."""
GROWN = {
    "algorithms/base.py": {
        '    """Copies of the environment that one run steps side by side."""\n': (
            '    newer_choice: str = "usual"\n    newer_number: NotNegative = 1.5\n'
        ),
    },
    "algorithms/actor_critic.py": {
        '        "entropy": parts.entropy,\n': '        "newer_scalar": 2 * parts.entropy,\n',
        "SCALARS = (": '"newer_scalar", ',
    },
    "training/diagnosis.py": {'        "sigma": std.mean(),\n': '        "newer_diagnosis": 0 * bias + 4,\n'},
}
"""Files of the source, and what is added behind a line of theirs."""


def write(source, folder, *arguments):
    folder.mkdir()
    environment = os.environ | {"PYTHONPATH": str(source)}
    command = [sys.executable, str(HERE / "writer.py"), str(folder), *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "names.json").read_text())


@pytest.fixture(scope="module")
def versions(tmp_path_factory):
    """The sources of both."""
    today, grown = Path(galton.__file__).parents[1], tmp_path_factory.mktemp("grown")
    shutil.copytree(today / "galton", grown / "galton", ignore=shutil.ignore_patterns("__pycache__"))
    for name, additions in GROWN.items():
        path = grown / "galton" / name
        text = path.read_text()
        for line, added in additions.items():
            assert text.count(line) == 1, f"{name} does not have {line!r} once"
            text = text.replace(line, line + added)
        path.write_text(text)
    return today, grown


@pytest.fixture(scope="module")
def written(versions, tmp_path_factory):
    """What both wrote with the fields at their defaults, the grown one after it went on with the other's."""
    today, grown = versions
    folder = tmp_path_factory.mktemp("written")
    first = write(today, folder / "today")
    return folder, first, write(grown, folder / "grown", folder / "today")


@pytest.fixture(scope="module", params=FIELDS)
def newer(versions, tmp_path_factory, request):
    """What the grown version wrote with a field that is not at its default, and the field."""
    folder = tmp_path_factory.mktemp("newer") / request.param
    write(versions[1], folder, f"{request.param}={FIELDS[request.param]}")
    return folder, request.param


def settings_of(path):
    with safe_open(path, "numpy") as file:
        return json.loads(file.metadata()["galton"])["settings"]


@pytest.mark.slow
@pytest.mark.parametrize("what", ["settings", "seeds", "shards", "plan", "done"])
def test_names_seeds_and_the_plans_bytes_stay_when_a_field_is_added(written, what):
    _, first, grown = written
    assert len(first[what]) > 0
    assert grown[what] == first[what]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a2c", "ppo"])
def test_a_checkpoints_settings_and_weights_stay_when_a_field_is_added(written, name):
    folder = written[0]
    ours, theirs = (folder / version / f"{name}.safetensors" for version in ("today", "grown"))
    assert settings_of(ours) == settings_of(theirs)
    assert not any("newer" in field for field in json.dumps(settings_of(theirs)).split('"'))
    first, grown = load_file(ours), load_file(theirs)
    assert grown.keys() - first.keys() == {"run/tally/diagnostics/newer_scalar"}
    for key, values in first.items():
        np.testing.assert_allclose(grown[key], values, rtol=1e-6, atol=1e-7, err_msg=key)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a2c", "ppo"])
def test_a_model_goes_on_where_its_algorithm_has_learnt_to_tell_more(written, name):
    logs = written[2]["logs"][name]
    assert len(logs) == 2
    # What the first log sums up began before there was such a scalar.
    assert np.isnan(logs[0]["train/newer_scalar"])
    assert logs[1]["train/newer_scalar"] == pytest.approx(2 * logs[1]["train/entropy"], rel=1e-5)
    assert all(log["train/newer_diagnosis"] == 4 for log in logs)
    assert np.isfinite(logs[0]["train/entropy"])


@pytest.mark.slow
def test_finished_shards_count_and_stand_in_one_table_with_new_ones(written):
    *_, grown = written
    assert grown["sweep"]["counted"] == [0]
    columns = grown["sweep"]["columns"]
    assert columns["setting"] == [0, 0, 4, 4]
    for name in ("newer_scalar", "newer_diagnosis", "entropy"):
        known = np.isfinite(columns[name]).all(1)
        assert known.tolist() == [name == "entropy"] * 2 + [True] * 2


def refused(field, read):
    with pytest.raises(NewerVersionError, match=field) as caught:
        read()
    assert not isinstance(caught.value, CheckpointError)
    assert "update Galton" in str(caught.value)
    assert "damaged" not in str(caught.value)


@pytest.mark.slow
def test_files_with_a_field_that_this_version_does_not_know_are_called_newer(newer):
    folder, field = newer
    refused(field, lambda: A2C.load(folder / "a2c.safetensors"))
    refused(field, lambda: PPO.load(folder / "ppo.safetensors", "bandit"))
    refused(field, lambda: Plan.load(Store(str(folder / "sweep"))))


def test_a_setting_of_a_checkpoint_that_this_version_does_not_know_is_called_newer(tmp_path):
    settings, arrays = checkpoint.read(A2C("bandit", "gaussian", net_arch=()).save(tmp_path / "today"))
    checkpoint.write(tmp_path / "newer", settings | {"newer_setting": 1}, arrays)
    refused("newer_setting", lambda: A2C.load(tmp_path / "newer"))


def test_shards_that_told_less_stand_in_one_table_with_those_that_tell_more():
    def told(*names):
        curve = pa.FixedSizeListArray.from_arrays(pa.array(np.float32([1, 2])), 2)
        return pa.table(dict.fromkeys(names, curve))

    earlier, later = same_columns([told("entropy"), told("entropy", "newer_scalar")])
    assert earlier.column_names == later.column_names == ["entropy", "newer_scalar"]
    assert np.isnan(earlier.column("newer_scalar").to_pylist()).all()
    assert earlier.column("entropy").to_pylist() == later.column("newer_scalar").to_pylist() == [[1, 2]]
