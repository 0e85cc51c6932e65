"""The page of promises says what the records say, and each promise has its test."""

import ast

import pytest

from .trust import PAGE, ROOT, TOPICS, Record, check, gather, load, note, number, outside, page, table

RECORD = Record("It holds.", "work", 50, "kills", "tests/test_a.py::test_b", "make", "2026-01-01", "1", at_least=50)


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


def test_without_a_folder_nothing_is_written_but_a_wrong_record_is_refused():
    def noted(**changes):
        known = {"promise": "It holds.", "topic": "work", "figure": 1, "unit": "runs", "at_most": 1}
        note(None, "tests/test_a.py::test_b", "name", **known | changes)

    noted()
    for changes in ({"topic": "other"}, {"promise": "It holds"}, {"at_least": 1}, {"figure": float("nan")}):
        with pytest.raises(AssertionError, match="name: "):
            noted(**changes)


def test_a_promise_that_was_not_kept_is_called_missed():
    for record, missed in (
        (RECORD, False),
        (RECORD._replace(figure=49), True),
        (RECORD._replace(at_least=None, at_most=0), True),
        (RECORD._replace(at_least=None, at_most=0, figure=0), False),
    ):
        assert ("missed" in table([record])) == missed


def test_a_row_leads_to_its_test():
    assert table([RECORD]).splitlines()[-1] == (
        '| It holds. | [test_a.py](../tests/test_a.py "test_b") | at least 50 | 50 kills |'
    )


@pytest.mark.parametrize(
    ("value", "shown"), [(0.0, "0"), (1250.0, "1,250"), (99.26, "99.3"), (3.41e-7, "3.41e-07"), (2345.6, "2,346")]
)
def test_numbers_are_shown_short(value, shown):
    assert number(value) == shown
