"""`galton check`: findings and the exit code."""

import pytest

from galton.cli import check
from galton.training.check import Check, Finding


@pytest.mark.parametrize(("ok", "code"), [(True, 0), (False, 1)])
def test_each_finding_has_a_line_and_the_exit_code_says_whether_it_can_be_used(ok, code, monkeypatch, capsys):
    asked = []
    findings = Finding("arrays", "one", "copy it"), Finding("steps", "[raised]", "mend it", ok)
    monkeypatch.setattr(check, "check_env", lambda *given: asked.append(given) or Check(findings))
    with pytest.raises(SystemExit) as left:
        check.main(["Own-v0", "--env-kwargs", '{"a": [1, 2]}'])
    assert left.value.code == code
    assert asked == [("Own-v0", {"a": (1, 2)})]
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines() if line.strip()]
    mark, words = "note" if ok else "stop", "it can be trained on" if ok else "it can't be trained on as it is"
    assert lines == ["arrays note: one", "-> copy it", f"steps {mark}: [raised]", "-> mend it", words]
