"""The mutants can be made: each changes a text that its file has once, and its tests are there."""

import ast

import pytest

from .runner import HERE, ROOT, load, mutated

MUTANTS = load()
SOURCE = ROOT / "src"


@pytest.mark.few
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_a_mutant_changes_one_place_of_a_program(mutant):
    changed = mutated(mutant, SOURCE)
    before, after = (ast.dump(ast.parse(text)) for text in ((SOURCE / mutant.file).read_text(), changed))
    assert before != after
    assert mutant.breaks.endswith(".")
    for test in mutant.tests:
        path, _, name = test.partition("::")
        assert (HERE.parent / path).is_file()
        assert not name or f"def {name}(" in (HERE.parent / path).read_text()


def test_there_are_enough_and_each_has_its_own_words():
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS) >= 60
