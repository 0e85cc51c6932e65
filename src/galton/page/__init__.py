"""One self-contained HTML page: claims, figures as inline SVG with the numbers behind them, and how they were made."""

from galton.extras import require_libraries

require_libraries("galton.page", "matplotlib", "jinja2")
