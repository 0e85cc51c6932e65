import io

from rich.console import Console

from galton import LOSSES
from galton.envs import LQR
from galton_experiments.analysis.comparison import Row
from galton_experiments.analysis.statistics import Interval
from galton_experiments.commands._compare_view import table


def row(loss, mean=-21.0, share=None, diverged=0, half=2.48):
    interval = Interval(mean, mean - half, mean + half)
    return Row(loss, interval, interval, share, 1234.5, 6.78, diverged, 4)


def text(*rows):
    console = Console(file=io.StringIO(), width=80)
    console.print(table(list(rows), LQR()))
    return console.file.getvalue()


def test_the_table_fits_a_terminal_and_holds_every_loss():
    of_paper = {name: loss.label for name, loss in LOSSES.items() if loss.in_paper}
    shown = " ".join(text(*(row(loss, share=-0.125) for loss in of_paper)).split())
    assert "…" not in shown
    assert all(label in shown for label in of_paper.values())
    for words in ("−21.00 ± 2.48", "−12.5%", "1,234", "6.8 s", "the optimum −9.77 100%"):
        assert words in shown


def test_what_is_not_known_is_left_out_or_a_dash_and_what_diverged_is_said():
    assert "optimum" not in text(row("gaussian"))
    assert "—" in text(row("gaussian"), row("hl-gauss", share=0.5))
    assert "left out of these means" in text(row("gaussian", diverged=3))
    assert "left out of these means" not in text(row("gaussian"))


def test_returns_of_any_scale_can_be_told_apart():
    assert "0.0013 ± 0.0002" in text(row("gaussian", 1.3e-3, half=2e-4), row("hl-gauss", 1.5e-3, half=1e-4))
    whole = text(row("gaussian", -12345.678, half=1234.5))
    assert "−12,345.68 ± 1,234.50" in whole
    assert "…" not in whole
