"""The paper's genetic algorithm: floating-point genes, fitness 1 / g, 100 generations of 100 (its section 3.2).

What the paper leaves open is chosen as usual: tournaments of two, blend crossover (BLX-0.5, Eshelman and Schaffer
1993), Gaussian mutation of a tenth of the genes whose size shrinks with the generations, the best one kept.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.units import Float

POPULATION, GENERATIONS = 100, 100
MUTATED, BLEND = 0.1, 0.5


def evolve(cost: Callable[[Float], Float], middle: Float, half: float, rng: np.random.Generator) -> Float:
    """Genes (3,) of least cost in a box about `middle`; `cost` takes (s, 3)."""
    genes = middle + half * rng.uniform(-1, 1, (POPULATION, 3))
    value = cost(genes)
    for generation in range(GENERATIONS):
        rivals = rng.integers(0, POPULATION, (2, POPULATION, 2))
        parents = genes[np.take_along_axis(rivals, np.argmin(value[rivals], axis=2)[..., None], axis=2)[..., 0]]
        share = rng.uniform(-BLEND, 1 + BLEND, (POPULATION, 3))
        children = share * parents[0] + (1 - share) * parents[1]
        size = half * 0.3 * (1 - generation / GENERATIONS) ** 2
        children += (rng.random(children.shape) < MUTATED) * rng.normal(0, 1, children.shape) * size
        children = np.clip(children, middle - half, middle + half)
        children[0] = genes[np.argmin(value)]
        genes, value = children, cost(children)
    return np.asarray(genes[np.argmin(value)])
