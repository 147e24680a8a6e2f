"""Sums over elements.

NumPy's own loops, not BLAS: BLAS starts threads nobody asked for, which spin when the machine is
busy, and the last bits of its sums depend on their number.
"""

import numpy as np

__all__ = ["combination", "dot", "energy_weights"]


def dot(one, two) -> float:
    """Σ one·two over all elements."""
    return float(np.einsum("i,i->", one.reshape(-1), two.reshape(-1)))


def energy_weights(pairs, right):
    """Weights w that solve Σⱼ (vᵢᵀKvⱼ) wⱼ = rightᵢ, from pairs (v, Kv); least norm if dependent."""
    gram = np.array([[dot(vector, image) for _, image in pairs] for vector, _ in pairs])
    norm = np.sqrt(np.diagonal(gram))
    scaled = gram / np.outer(norm, norm)
    return np.linalg.lstsq(scaled, np.asarray(right) / norm, rcond=1e-10)[0] / norm


def combination(weights, pairs):
    """The pair (Σ w·v, Σ w·Kv)."""
    return tuple(
        sum(w * v for w, v in zip(weights, c, strict=True)) for c in zip(*pairs, strict=True)
    )
