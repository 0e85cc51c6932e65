"""The Hugging Face Hub: one function talks to it, and nothing else does."""

import re
from collections.abc import Mapping

from galton.errors import UsageError, require
from galton.extras import needed


def check_repository(name: str) -> None:
    """Raise UsageError unless this is the name of a repository, OWNER/NAME."""
    part = r"[A-Za-z0-9][\w.-]{0,95}"
    require(
        re.fullmatch(f"{part}/{part}", name, re.ASCII) is not None,
        f"push is {name!r}; it must be OWNER/NAME, such as ada/pendulum, of letters, digits, '.', '_' and '-'",
    )


def upload(repository: str, contents: Mapping[str, bytes]) -> str:
    """Put files into a repository of models in one commit, and return its address.

    A repository that is not there is made, and is private: its owner makes it public.

    Args:
        repository: OWNER/NAME.
        contents: by the files' names.

    Raises:
        UsageError: huggingface_hub is not installed, nobody is logged in, or the Hub refuses or can't be reached.
    """
    with needed("push", "huggingface_hub"):
        from huggingface_hub import CommitOperationAdd, HfApi
    operations = [CommitOperationAdd(name, content) for name, content in contents.items()]
    try:
        api = HfApi(library_name="galton")
        address = api.create_repo(repository, private=True, exist_ok=True)
        api.create_commit(repository, operations, commit_message="A policy exported by Galton")
    except Exception as error:  # of whichever network library the Hub's client uses
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise UsageError(
            f"push is {repository}, which could not be uploaded: {told}; the files are written here all the same. "
            "`hf auth login` says who you are, with a token that may write"
        ) from error
    return str(address)
