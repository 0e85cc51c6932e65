"""What gives the same bits, and what gives almost the same numbers: docs/determinism.md."""

import platform

import pytest

from .determinism import CASES, SEEDS, bytes_apart, distance, runs, trained

FIRST, SECOND = ({"PYTHONHASHSEED": seed} for seed in "01")
RUN = "A run with the same seed and settings gives the same bits"


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_another_process_on_one_core_gives_the_same_bits(case, tmp_path, trust):
    if case == "mujoco":
        pytest.importorskip("mujoco")
    first = trained(tmp_path, [case], environment=FIRST)
    second = trained(tmp_path, [case], environment=SECOND, cores=1)  # where JAX sees one device, it compiles again
    apart = bytes_apart(first, second)
    assert apart == 0
    assert bytes_apart(runs(first, [0]), runs(first, [1])) > 100, "other seeds give other numbers"
    trust(
        "same-bits-in-another-process",
        f"{RUN} in another process, on one core or all: A2C and PPO, in JAX, on Gymnasium and on MuJoCo.",
        topic="numbers",
        figure=apart,
        unit="bytes differ",
        at_most=0,
        over="sum",
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the reference keeps its compiled programs, for those that find them there."""
    return tmp_path_factory.mktemp("determinism")


@pytest.fixture(scope="module")
def reference(folder):
    return trained(folder)


def shared(reference, seeds):
    """The reference's runs of the seeds that both have, and where these runs are among theirs."""
    both = [seed for seed in seeds if seed in SEEDS]
    assert both
    return runs(reference, [SEEDS.index(seed) for seed in both]), [[*seeds].index(seed) for seed in both]


EXACT = {
    "among other runs": {"seeds": (7, 2, 9, 0)},
    "compiled again": {"environment": {"JAX_ENABLE_COMPILATION_CACHE": "false"}},
}


@pytest.mark.slow
@pytest.mark.parametrize("way", EXACT)
def test_neither_its_neighbours_nor_a_new_program_change_a_run(way, reference, folder, trust):
    ours, rows = shared(reference, EXACT[way].get("seeds", SEEDS))
    apart = bytes_apart(ours, runs(trained(folder, **EXACT[way]), rows))
    assert apart == 0
    trust(
        "same-bits-among-others",
        f"{RUN} at another place among as many other runs, with a program that was kept or compiled again.",
        topic="numbers",
        figure=apart,
        unit="bytes differ",
        at_most=0,
        over="sum",
    )


CLOSE = {
    "close-alone": (
        {"seeds": (0,)},
        "A run alone ends close to the same run beside three others.",
    ),
    "close-two-devices": (
        {"seeds": range(8), "devices": 2},
        "Runs on one device end close to the same runs on two devices that share a program.",
    ),
    "close-no-avx-512": (
        {"environment": {"XLA_FLAGS": "--xla_cpu_max_isa=AVX2"}},
        "Programs for a processor without AVX-512 end close to those for this one.",
    ),
    "close-not-optimised": (
        {
            "environment": {
                "JAX_DISABLE_MOST_OPTIMIZATIONS": "1",
                "XLA_FLAGS": "--xla_cpu_use_fusion_emitters=false",
            }
        },
        "Programs that XLA did not optimise end close to those that it did.",
    ),
}
"""By name of the record: what differs, and what is then only close."""


@pytest.mark.slow
@pytest.mark.parametrize("way", CLOSE)
def test_other_programs_for_the_same_runs_stay_close(way, reference, folder, trust):
    differs, promise = CLOSE[way]
    if way == "close-no-avx-512" and platform.machine() != "x86_64":
        pytest.skip("this processor has no AVX")
    ours, rows = shared(reference, differs.get("seeds", SEEDS))
    apart = distance(ours, runs(trained(folder, **differs), rows))
    assert apart < 1e-4
    trust(
        way,
        promise,
        topic="numbers",
        figure=apart,
        unit="of an array's largest parameter, after 200 updates at most",
        at_most=1e-4,
    )
