"""How a contact answers a displacement while its elements stay the same."""

import numpy as np

from .algebra import dot
from .preconditioner import Preconditioner
from .window import Window

__all__ = ["unit_response"]

# Largest relative error of the unit displacement on the contact under the response's pressure.
_TOLERANCE = 3e-3


def unit_response(half_space, contact, start=None):
    """Response to displacement on a fixed contact set: dp/dδ, and the stiffness.

    Solves K p' = 1 on the contact, p' = 0 elsewhere, by preconditioned conjugate gradients.

    Parameters
    ----------
    half_space : HalfSpace
    contact : ndarray of bool, shape (ny, nx)
        Elements whose pressure follows the displacement.
    start : ndarray, shape (ny, nx), optional
        A response to start from.

    Returns
    -------
    response : ndarray, shape (ny, nx)
        p' (MPa/mm), such that K p' is 1 on the contact within 3e-3.
    stiffness : float
        d(mean pressure)/dδ (MPa/mm). Its error is of second order in that of p'.
    """
    response = np.zeros(contact.shape)
    elements = np.flatnonzero(contact)
    if not elements.size:
        return response, 0.0
    window = Window(half_space, elements)
    preconditioner = Preconditioner(window)
    preconditioner.fit(np.ones(elements.size, bool))
    if start is None or not start[contact].any():
        solution = preconditioner.uniform
    else:
        solution = start.reshape(-1)[elements]
    image = window.displacement(solution)
    factor = solution.sum() / dot(solution, image)
    solution = factor * solution
    residual = 1 - factor * image
    direction, previous = 0.0, 1.0
    while np.abs(residual).max() > _TOLERANCE:
        preconditioned = preconditioner(residual)
        product = dot(residual, preconditioned)
        direction = preconditioned + direction * (product / previous)
        previous = product
        image = window.displacement(direction)
        scale = product / dot(direction, image)
        solution = solution + scale * direction
        residual = residual - scale * image
    response.reshape(-1)[elements] = solution
    # The energy 2·Σp' − p'ᵀKp', stationary at the solution where it equals Σp'.
    return response, float((solution.sum() + dot(residual, solution)) / response.size)
