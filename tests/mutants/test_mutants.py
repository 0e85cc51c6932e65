"""The mutants can be made: each changes a text that its file has once, and its tests are there."""

import ast
import functools

from .runner import HERE, ROOT, load, mutated

MUTANTS = load()
SOURCE = ROOT / "src"


def test_each_mutant_changes_one_place_of_a_program():
    program = functools.cache(lambda file: ast.dump(ast.parse((SOURCE / file).read_text())))
    for mutant in MUTANTS:
        assert ast.dump(ast.parse(mutated(mutant, SOURCE))) != program(mutant.file), mutant.name
        assert mutant.breaks.endswith(".")
        for test in mutant.tests:
            path, _, name = test.partition("::")
            assert (HERE.parent / path).is_file(), mutant.name
            assert not name or f"def {name}(" in (HERE.parent / path).read_text(), mutant.name


def test_there_are_enough_and_each_has_its_own_words():
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS) >= 60
