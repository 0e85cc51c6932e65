"""The examples, and the Python of the documents, as somebody who copies them runs them."""

import re

import pytest

from .running import ROOT, check, examples, run_chosen

OF_EXPERIMENTS = ("a_sweep", "new_study")
"""tests/experiments/test_examples.py has them."""
ELSEWHERE = ("deploy", "cleanrl_ppo_histogram", "brax_ppo_histogram", *OF_EXPERIMENTS)
"""Their tests are tests/deploy/test_example.py, tests/torch/test_example.py and tests/others/test_libraries.py."""
SHORT = ("new_loss", "new_schedule", "own_gymnasium")
LONG = sorted({path.stem for path in (ROOT / "examples").glob("*.py")} - {*SHORT, *ELSEWHERE})
BLOCKS = [
    pytest.param(f"{path.stem}-{n}", block, id=f"{path.stem}-{n}")
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    if path.stem != "tutorial"  # it needs the run that its commands train
    for n, block in enumerate(re.findall(r"```python\n(.*?)```", path.read_text(), re.S))
]


@pytest.fixture(scope="module")
def folders(request, tmp_path_factory):
    return run_chosen(request, tmp_path_factory)


@pytest.mark.parametrize(("name", "text"), examples(*SHORT) + [block for block in BLOCKS if "README" in block.id])
def test_a_short_example_and_the_readmes_python_run(name, text, folders):
    check(folders[name], text)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "text"), examples(*LONG) + [block for block in BLOCKS if "README" not in block.id])
def test_a_long_example_and_python_in_a_document_run(name, text, folders):
    check(folders[name], text)


def test_the_documents_have_python():
    assert len(BLOCKS) >= 4
    assert any("best_model=" in block.values[1] for block in BLOCKS)
