"""What is believed of some numbers after many measurements of weighted sums of them."""

from __future__ import annotations

import numpy as np

from bt_dualarm.pose import Matrix, Vector


class Beliefs:
    """Linear least squares in information form, with a prior: numbers may come and go.

    Every number is in units of what it was doubted by before anything was measured: its prior is
    normal, around 0, with deviation 1.

    Args:
        count: How many numbers there are at first.
    """

    def __init__(self, count: int) -> None:
        self._information = np.eye(count)
        self._vector = np.zeros(count)

    def measure(self, columns: Matrix, values: Vector, weights: Vector) -> None:
        """Take up measurements.

        Args:
            columns: Factors of the numbers in each, of shape (n, count).
            values: What was measured, of shape (n,).
            weights: One over the variance of each, of shape (n,).
        """
        weighted = columns.T * weights
        self._information += weighted @ columns
        self._vector += weighted @ values

    def add(self, count: int) -> None:
        """Reckon with more numbers, behind those that there are."""
        old, size = self._information, len(self._vector) + count
        self._information = np.eye(size)
        self._information[: len(old), : len(old)] = old
        self._vector = np.concatenate((self._vector, np.zeros(count)))

    def drop(self, first: int, count: int) -> None:
        """Forget numbers, and keep what they have told of the others (Schur complement)."""
        gone = np.zeros(len(self._vector), dtype=bool)
        gone[first : first + count] = True
        shared = self._information[np.ix_(~gone, gone)]
        told = np.linalg.solve(self._information[np.ix_(gone, gone)], shared.T).T
        self._vector = self._vector[~gone] - told @ self._vector[gone]
        self._information = self._information[np.ix_(~gone, ~gone)] - told @ shared.T

    def told(self, first: int, count: int) -> tuple[Vector, Matrix]:
        """Means and covariance of ``count`` numbers, of shapes (count,) and (count, count)."""
        part = slice(first, first + count)
        wanted = np.eye(len(self._vector))[:, part]
        columns = np.column_stack((self._vector, wanted))
        found = np.asarray(np.linalg.solve(self._information, columns)[part], dtype=np.float64)
        return found[:, 0], found[:, 1:]
