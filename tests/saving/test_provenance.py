import importlib.metadata
import platform

import galton
from galton.saving import provenance


def test_versions_are_those_of_what_is_installed():
    known = provenance.versions("pytest", "no-such-package")
    assert known["galton"] == galton.__version__
    for name in {*provenance.PACKAGES, "pytest"} - {"galton"}:
        assert known[name] == importlib.metadata.version(name)
    assert known["no-such-package"] is None
    assert known["python"] == platform.python_version()
    assert list(provenance.versions())[-2:] == ["commit", "python"]


def test_the_commit_is_that_of_this_checkout_or_none_and_the_machine_has_a_name_and_a_processor():
    commit = provenance.commit()
    assert commit is None or len(commit.removesuffix("-dirty")) >= 12
    assert platform.node() in provenance.machine()
    assert provenance.processor()
