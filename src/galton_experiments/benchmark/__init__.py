"""A fair comparison of methods as one file, which is written before anything is trained.

The file says what is searched and how it is judged (priors, protocol). Each method gets the same number of draws
(draws), which are trained in stages (stages) in a folder that remembers the file (folder, runs). One draw is selected
for all tuning tasks and one for each (selection); fresh seeds judge them (standings), and tables, figures and a page
tell what came of it.
"""

from galton.extras import require_libraries

require_libraries("galton_experiments.benchmark", "pyarrow", "matplotlib")
