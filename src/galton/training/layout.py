"""The devices of a population, and what is split over them."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from galton.training.run import Tree


class Layout(NamedTuple):
    """The devices that train, and what is split over them: runs, or the copies of the environment of a single run."""

    mesh: Mesh

    @classmethod
    def of(cls, devices: Sequence[jax.Device], n_runs: int, n_envs: int) -> "Layout":
        """Runs are split, where there are several; of one run its copies, over as many devices as divide them."""
        n_parts = math.gcd(len(devices), n_envs) if n_runs == 1 else 1
        if n_parts > 1:
            return cls(Mesh(devices[:n_parts], "copies"))
        return cls(Mesh(devices[: min(len(devices), n_runs)], "runs"))

    @property
    def of_copies(self) -> bool:
        """True if copies are split, and not runs."""
        return self.mesh.axis_names == ("copies",)

    @property
    def everywhere(self) -> NamedSharding:
        """Whole on each device."""
        return NamedSharding(self.mesh, PartitionSpec())

    @property
    def of_runs(self) -> NamedSharding:
        """Of what each run has, its numbers and what it has learnt: `[R, ...]`."""
        return self.everywhere if self.of_copies else NamedSharding(self.mesh, PartitionSpec("runs"))

    def of_envs(self, axis: int) -> NamedSharding:
        """Of what has an axis for the copies, the one of that number, behind that of the runs."""
        if not self.of_copies:
            return self.of_runs
        return NamedSharding(self.mesh, PartitionSpec(*[None] * axis, "copies"))

    def on_all(self, f: Callable[..., Tree], in_axes: tuple[int | None, ...]) -> Callable[..., Tree]:
        """A function of the runs of a device, for those of all devices. An argument without an axis is shared.

        Where copies are split the function stays as it is, and XLA makes its sums over the devices.
        """
        if self.of_copies:
            return f
        specs = tuple(PartitionSpec() if axis is None else self.of_runs.spec for axis in in_axes)
        return jax.shard_map(f, mesh=self.mesh, in_specs=specs, out_specs=self.of_runs.spec, check_vma=False)
