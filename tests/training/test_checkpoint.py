import jax
import numpy as np
import pytest

from galton import LOSSES, Config, Hypers, UsageError, train
from galton.envs import LQR
from galton.training.checkpoint import Checkpoint, load, save


@pytest.mark.parametrize("loss", LOSSES)
def test_a_checkpoint_comes_back_bit_for_bit(loss, tmp_path):
    config = Config(loss=loss, n_bins=10, net_arch=(8,))
    result = train(LQR(noise_std=0.1), config, Hypers(1e-3), [4], 40, n_eval_episodes=0)
    learner = jax.tree.map(lambda x: x[0], result.learner)
    checkpoint = Checkpoint("lqr", {"noise_std": 0.1}, config, Hypers(1e-3), 4, 40, learner)
    save(tmp_path, checkpoint)
    back = load(tmp_path)
    assert back._replace(learner=None) == checkpoint._replace(learner=None)
    assert back.make_env() == LQR(noise_std=0.1)
    assert jax.tree.structure(back.learner) == jax.tree.structure(learner)
    for a, b in zip(jax.tree.leaves(back.learner), jax.tree.leaves(learner), strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def test_arrays_that_do_not_fit_the_settings_are_refused(tmp_path):
    config = Config(n_bins=10, net_arch=(8,))
    result = train(LQR(), config, Hypers(), [0], 20, n_eval_episodes=0)
    learner = jax.tree.map(lambda x: x[0], result.learner)
    save(tmp_path, Checkpoint("lqr", {}, config, Hypers(), 0, 20, learner))
    text = (tmp_path / "checkpoint.json").read_text()
    (tmp_path / "checkpoint.json").write_text(text.replace('"n_bins": 10', '"n_bins": 11'))
    with pytest.raises(UsageError, match=r"params/actor/1/bias in the checkpoint has shape \(20,\)"):
        load(tmp_path)
