"""Python keeps its programs where the commands do."""

import subprocess
import sys

import pytest

from galton.training.programs_on_disk import PLACE

from ..cli.test_programs import entries, keeping

MODEL = """
import galton
model = galton.A2C("bandit", "gaussian", net_arch=(4,)).learn(10, progress_bar=False)
print(model.population.compile_seconds)
"""


def python(source, programs, **environment):
    done = subprocess.run(
        [sys.executable, "-c", source], capture_output=True, text=True, env=keeping(programs) | environment, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.slow
def test_a_second_process_compiles_nothing(tmp_path):
    python(MODEL, tmp_path / "programs")
    kept = entries(tmp_path / "programs")
    assert len(kept) > 2
    python(MODEL, tmp_path / "programs")
    assert entries(tmp_path / "programs") == kept


@pytest.mark.slow
@pytest.mark.parametrize("off", [{PLACE: "off"}, {"JAX_COMPILATION_CACHE_DIR": "elsewhere"}])
def test_importing_and_looking_keeps_nothing(tmp_path, off):
    python("import galton, jax; galton.PPO; assert not jax.config.jax_compilation_cache_dir", tmp_path / "programs")
    source = "from galton.training.programs_on_disk import keep_programs; keep_programs()"
    python(source, tmp_path / "programs", **off)
    assert not (tmp_path / "programs").exists()
