"""Entropy of neighbourhoods' shapes: how ambiguous they are between line, plane and volume."""

from __future__ import annotations

import math

import numpy as np

from lidar_buildings.core.kernels import kernel
from lidar_buildings.core.surfaces.symmetric_eigen import SMALLEST, eigenvalues_3x3

LN_2 = math.log(2.0)
#: The bits of √½, from which on a number's exponent is counted: what is left lies between √½ and √2.
SQRT_HALF_BITS = int(np.float64(math.sqrt(0.5)).view(np.int64))
#: 2 atanh t = 2t + 2t³/3 + 2t⁵/5 + …, the highest power first; |t| ≤ 0.172 leaves 1e-15.
SERIES = tuple(2.0 / power for power in range(17, 0, -2))


@kernel
def entropy_of_shape(xx, xy, xz, yy, yz, zz):  # type: ignore[no-untyped-def]
    """
    Return the entropy of a covariance or any multiple of it, infinite where all neighbours coincide.

    That of a1 = (σ1 − σ2)/σ1, a2 = (σ2 − σ3)/σ1, a3 = σ3/σ1 with σ = √λ (Demantké and others, 2011).
    """
    first, second, third = eigenvalues_3x3(xx, xy, xz, yy, yz, zz)
    s1, s2, s3 = math.sqrt(first), math.sqrt(second), math.sqrt(third)
    scale = 1.0 / max(s1, SMALLEST)
    a1, x1, e1 = _parts((s1 - s2) * scale)
    a2, x2, e2 = _parts((s2 - s3) * scale)
    a3, x3, e3 = _parts(s3 * scale)
    # One division for three: each logarithm needs (x − 1)/(x + 1).
    y1, y2, y3 = x1 + 1.0, x2 + 1.0, x3 + 1.0
    scale = 1.0 / (y1 * y2 * y3)
    entropy = -a1 * _log((x1 - 1.0) * (y2 * y3 * scale), e1)
    entropy -= a2 * _log((x2 - 1.0) * (y1 * y3 * scale), e2)
    entropy -= a3 * _log((x3 - 1.0) * (y1 * y2 * scale), e3)
    return entropy if xx + yy + zz > 0.0 else np.inf


@kernel
def _parts(share):  # type: ignore[no-untyped-def]
    """Return a share, at least `SMALLEST`, and x and e of it: a = x 2^e, x between √½ and √2."""
    share = max(share, SMALLEST)
    bits = np.float64(share).view(np.int64)
    exponent = (bits - SQRT_HALF_BITS) >> 52
    return share, np.int64(bits - (exponent << 52)).view(np.float64), exponent


@kernel
def _log(t, exponent):  # type: ignore[no-untyped-def]
    """
    Return ln a = 2 atanh t + e ln 2 for t = (x − 1)/(x + 1) of `_parts`.

    Unlike the library's logarithm it can be part of a vector instruction.
    """
    square, log = t * t, SERIES[0]
    for k in range(1, len(SERIES)):
        log = log * square + SERIES[k]
    return log * t + exponent * LN_2
