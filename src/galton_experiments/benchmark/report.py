"""A benchmark's results as files: all numbers, the figures and the page; the same bytes for the same runs."""

from galton_experiments.analysis import plots
from galton_experiments.benchmark import page
from galton_experiments.benchmark.folder import written
from galton_experiments.benchmark.found import Found
from galton_experiments.sweep.store import Store

NUMBERS, PAGE = "report.json", "index.html"


def write(store: Store, found: Found) -> None:
    """Write what there is so far into the folder."""
    drawn = page.figures(found)
    text = page.page(found, drawn)
    for name, figure in drawn.items():
        for suffix, image in plots.images(figure).items():
            store.write(f"figures/{name}{suffix}", image)
    store.write(PAGE, text.encode())
    store.write(NUMBERS, written(found.record()))
