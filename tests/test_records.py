"""What a newer version wrote is called newer, and what an earlier one did not tell is not known."""

import numpy as np
import pyarrow as pa
import pytest

from galton import A2C, CheckpointError, NewerVersionError
from galton.saving import checkpoint
from galton_experiments.sweep.results import same_columns


def refused(field, read):
    with pytest.raises(NewerVersionError, match=field) as caught:
        read()
    assert not isinstance(caught.value, CheckpointError)
    assert "update Galton" in str(caught.value)
    assert "damaged" not in str(caught.value)


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
