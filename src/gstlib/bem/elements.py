"""Some elements of a grid, as vectors hold their values and blocks of the grid's rows do."""

from itertools import pairwise

import numpy as np

__all__ = ["Elements"]


class Elements:
    """Elements of a grid.

    Parameters
    ----------
    rows, columns : ndarray of int, shape (n,)
        Row by row: the rows ascend.
    """

    def __init__(self, rows, columns):
        self.rows, self.columns = rows, columns
        self._layouts = {}

    def layout(self, shape, block_rows, stride):
        """Where the elements lie in memory that holds a block of a grid's rows at a time.

        Parameters
        ----------
        shape : (int, int)
            Of the grid (ny, nx).
        block_rows : int
            Rows in a block.
        stride : int
            Numbers from one row in memory to the next.

        Returns
        -------
        places : ndarray of int, shape (n,)
            Of each element in its block.
        parts : list of slice
            The elements of each block.
        """
        key = shape, block_rows, stride
        if key not in self._layouts:
            ends = np.searchsorted(self.rows, np.arange(0, shape[0] + block_rows, block_rows))
            self._layouts[key] = (
                self.rows % block_rows * stride + self.columns,
                [slice(*part) for part in pairwise(ends)],
            )
        return self._layouts[key]
