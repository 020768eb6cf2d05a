"""The prior of the stacker's weights, an empirical Bayes estimate over many small and large learning tasks.

`python -m benchmarks.stacker` draws the tasks from the training people of MSR Action3D (1, 3, 5, 7, 9), and from
Florence 3D, Northwestern-UCLA, karate and Kinder-Gator, beside storytelling as other motion, and writes the table.
"""

import numpy as np

from observer.model import stacker_prior_table as table
from observer.model.stacker import CONTEXT, EVIDENCE, MEMBERS, OTHER_CONTEXT, TASK, Gaussians, StackerPrior


def _gaussians(means: str, spreads: str, shape: tuple[int, int]) -> Gaussians:
    return Gaussians(
        np.array(means.split(), np.float64).reshape(len(TASK), *shape),
        np.array(spreads.split(), np.float64).reshape(shape),
    )


PRIOR = StackerPrior(
    _gaussians(table.WEIGHTS_MEANS, table.WEIGHTS_SPREADS, (len(MEMBERS), len(CONTEXT))),
    _gaussians(table.OTHER_MEANS, table.OTHER_SPREADS, (len(EVIDENCE), len(OTHER_CONTEXT))),
)
