"""Somebody who comes from Stable-Baselines3 is told what to type here."""

import functools
from typing import TYPE_CHECKING, Any

from galton.errors import UsageError, require

POLICIES = ("MlpPolicy", "CnnPolicy", "MultiInputPolicy", "MlpLstmPolicy")
"""The names that SB3's models take before the environment."""

HINTS = {
    "policy_kwargs": "its entries are settings here, such as net_arch=(64, 64) and activation='relu'",
    "tensorboard_log": "give learn(callback=galton.callbacks.TensorBoard(folder))",
    "device": "JAX chooses the device; the environment variable JAX_PLATFORMS=cpu keeps it off an accelerator",
    "use_sde": "there is no state-dependent exploration here; noise_correlation=0.9 makes noise last",
    "sde_sample_freq": "there is no state-dependent exploration here",
    "use_rms_prop": 'give optimizer="rmsprop"; Adam is the usual one',
    "rms_prop_eps": 'optimizer="rmsprop" has 1e-5, as SB3\'s by default',
    "clip_range_vf": "PPO alone clips how far values move",
    "stats_window_size": "a log tells of the episodes that ended since the last log point",
    "monitor_wrapper": "episodes are counted without a Monitor",
    "n_timesteps": "it is an argument of learn: learn(total_timesteps)",
    "total_timesteps": "it is an argument of learn: learn(total_timesteps)",
    "n_eval_episodes": "give learn(callback=galton.callbacks.Evaluate(n_episodes=...))",
    "eval_freq": "give learn(callback=galton.callbacks.Evaluate(every=...))",
    "eval_env": "give learn(callback=galton.callbacks.Evaluate(env=...))",
    "reset_num_timesteps": "a model always counts on; make a new one to begin again",
    "tb_log_name": "give callback=galton.callbacks.TensorBoard(folder)",
    "target_kl": "PPO has it; TRPO's is max_kl, which is sb3-contrib's target_kl times the numbers of an action",
    "sub_sampling_factor": "every step of a rollout counts in TRPO's matrix",
    "custom_objects": "a file holds settings and numbers, and no objects",
    "print_system_info": "a file loads on any system",
    "force_reset": "the run goes on where it was; set_env(env) begins new episodes",
}
"""Arguments of SB3's that are not there, and what takes their place."""


KEPT = (
    "a model keeps its settings, where a number may be a schedule; make another model with it, which goes on with "
    "set_parameters(get_parameters())"
)
"""The remedy for whoever would change a setting of a model that is there."""


def refuse_policy(model: str, env: object, loss: object) -> None:
    """Raise UsageError where a model was given SB3's policy in the place of the environment."""
    given, first = isinstance(env, str) and env in POLICIES, "env" if loss is None else repr(loss)
    require(not given, f"env is {env!r}; {model} takes no such policy: {model}({first}, ...) is enough")


def unexpected(function: str, name: str, known: str = "") -> TypeError:
    """The error for a keyword argument that a function does not take."""
    hint = known or HINTS.get(name, "")
    return TypeError(f"{function}() got an unexpected keyword argument {name!r}{hint and f'; {hint}'}")


if TYPE_CHECKING:
    of_class = classmethod
else:

    class of_class(classmethod):  # noqa: N801
        """A classmethod that makes an instance. Called on one it would leave that as it is, and so it refuses."""

        def __get__(self, instance, owner=None):
            """The method of the class; UsageError at a call of an instance's, with what to write."""
            method = super().__get__(instance, owner)
            return method if instance is None else functools.partial(_refuse_instance, instance, method)


def _refuse_instance(instance: object, method: Any, *_: object, **__: object) -> None:
    name = f"{type(instance).__name__}.{method.__name__}"
    raise UsageError(f"{name} makes a new model and leaves this one as it is; write model = {name}(path)")
