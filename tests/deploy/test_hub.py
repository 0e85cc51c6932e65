"""What is pushed, and what is said where it can't be. Nothing here reaches a network."""

import sys
import types

import pytest

from galton import UsageError
from galton.deploy import hub


@pytest.fixture
def there(monkeypatch):
    """A Hub that notes what it is asked for, and raises its `error` if it has one."""
    asked = types.SimpleNamespace(calls=[], error=None)

    class HfApi:
        def __init__(self, library_name):
            asked.calls.append(("api", library_name))

        def create_repo(self, repo_id, *, private, exist_ok):
            if asked.error:
                raise asked.error
            asked.calls.append(("repository", repo_id, private, exist_ok))
            return f"https://hub.example/{repo_id}"

        def create_commit(self, repo_id, operations, *, commit_message):
            asked.calls.append(("commit", repo_id, operations, commit_message))

    def operation(path_in_repo, path_or_fileobj):
        return path_in_repo, path_or_fileobj

    fake = types.SimpleNamespace(HfApi=HfApi, CommitOperationAdd=operation)
    monkeypatch.setitem(sys.modules, "huggingface_hub", fake)
    return asked


def test_files_go_into_one_commit_of_a_private_repository(there):
    assert hub.upload("ada/pendulum", {"a": b"1", "README.md": b"2"}) == "https://hub.example/ada/pendulum"
    assert there.calls == [
        ("api", "galton"),
        ("repository", "ada/pendulum", True, True),
        ("commit", "ada/pendulum", [("a", b"1"), ("README.md", b"2")], "A policy exported by Galton"),
    ]


class NetworkError(Exception):
    """As a library raises it whose errors are not Python's."""


@pytest.mark.parametrize("kind", [OSError, ValueError, RuntimeError, NetworkError])
def test_a_hub_that_refuses_is_told_with_the_remedy(kind, there):
    there.error = kind("401\nno token")
    message = f"^push is ada/pendulum, which could not be uploaded: {kind.__name__}: 401 no token; .*`hf auth login`"
    with pytest.raises(UsageError, match=message):
        hub.upload("ada/pendulum", {})


def test_without_the_extra_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(UsageError, match=r"push needs huggingface_hub: pip install .*\[hub\]'"):
        hub.upload("ada/pendulum", {})


@pytest.mark.parametrize("name", ["ada/pendulum", "a/b", "Ada-1/pendulum_v1.2"])
def test_a_name_of_a_repository_is_taken(name):
    hub.check_repository(name)


@pytest.mark.parametrize("name", ["", "pendulum", "a/b/c", "../x", "a/..", "a/b\n", "a b/c", "ada/" + "x" * 97, "é/a"])
def test_what_is_no_name_of_a_repository_is_refused(name):
    with pytest.raises(UsageError, match=r"push is .*; it must be OWNER/NAME, such as"):
        hub.check_repository(name)
