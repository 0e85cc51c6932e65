"""The page of promises says what the records say, and each promise has its test."""

import ast

import pytest

from .trust import PAGE, ROOT, TOPICS, check, gather, load, note, outside, page


@pytest.mark.parametrize("name", load())
def test_a_record_is_complete_and_its_test_exists(name):
    record = load()[name]
    check(name, record)
    path, _, function = record.test.partition("::")
    assert (ROOT / path).is_file(), f"{name} names {path}"
    assert path.startswith(("tests/", "studies/tests/")) or record == outside()[name], "python -m tests.trust"
    if function:
        functions = {node.name for node in ast.walk(ast.parse((ROOT / path).read_text())) if hasattr(node, "name")}
        assert function in functions, f"{path} has no {function}"
        used = f'"{name}"'
        assert used in (ROOT / path).read_text(), f"{path} does not measure {used}"


def test_the_page_shows_the_records():
    text = PAGE.read_text()
    assert page(text, load().values()) == text, "python -m tests.trust"
    assert all(f"<!-- table: {title} -->" in text for title in TOPICS.values())
    records = load().values()
    assert text.count("\n| ") == len(records) + len({record.topic for record in records})  # a head for each table


def test_the_cases_of_a_test_become_one_record(tmp_path):
    def measured(name, test, figures, over):
        for case, figure in figures.items():
            more = {"topic": "work", "unit": "kills", "at_least": 2, "over": over}
            note(tmp_path, f"tests/test_a.py::{test}[{case}]", name, "Nothing is lost.", figure=figure, **more)

    measured("sum", "test_s", {"a-1": 1, "b[2]": 2}, "sum")
    measured("largest", "test_l", {"a": 1, "b": 2}, "largest")
    measured("smallest", "test_m", {"a": 1, "b": 2}, "smallest")
    measured("largest", "test_l", {"b": 3}, "largest")  # measured again
    found = gather(tmp_path)
    assert {name: record.figure for name, record in found.items()} == {"sum": 3, "largest": 3, "smallest": 1}
    assert found["sum"].test == "tests/test_a.py::test_s"
    assert found["sum"].command == "make trust TESTS=tests/test_a.py::test_s"
    measured("sum", "test_other", {"a": 1}, "sum")
    with pytest.raises(AssertionError, match="sum is the name of two records"):
        gather(tmp_path)
