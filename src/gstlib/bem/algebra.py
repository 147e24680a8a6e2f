"""Sums over elements.

NumPy's own loops, not BLAS: BLAS starts threads nobody asked for, which spin when the machine is
busy, and the last bits of its sums depend on their number.
"""

import numpy as np

__all__ = ["combination", "dot", "energy_weights"]

# Two directions are dependent when rounding may have left this of their Gram determinant.
_DEPENDENT = 1e-10


def dot(one, two) -> float:
    """Σ one·two over all elements."""
    return float(np.einsum("i,i->", one.reshape(-1), two.reshape(-1)))


def energy_weights(pairs, right):
    """Weights w that solve Σⱼ (vᵢᵀKvⱼ) wⱼ = rightᵢ, from one or two pairs (v, Kv).

    The second has no weight where it says nothing that the first does not.
    """
    (first, image), *others = pairs
    energy = dot(first, image)
    if not others:
        return np.array([right[0] / energy])
    second, second_image = others[0]
    mixed, other_energy = dot(second, image), dot(second, second_image)
    determinant = energy * other_energy - mixed**2
    if not determinant > _DEPENDENT * energy * other_energy:
        return np.array([right[0] / energy, 0.0])
    return np.array(
        [
            (other_energy * right[0] - mixed * right[1]) / determinant,
            (energy * right[1] - mixed * right[0]) / determinant,
        ]
    )


def combination(weights, vectors):
    """Σ w·v."""
    total = weights[0] * vectors[0]
    for weight, vector in zip(weights[1:], vectors[1:], strict=True):
        total += weight * vector
    return total
