"""Counter-based random numbers: the same for a pulse whatever was drawn before, so in any order of work."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.kernels import kernel

#: Increment and multipliers of SplitMix64 (Steele, Lea & Flood 2014).
GAMMA = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
#: 2⁻⁵³: the 53 bits of a float64 in [0, 1).
ULP = 1.0 / 9007199254740992.0


@kernel
def mixed(z):
    """Scramble 64 bits: the finaliser of SplitMix64."""
    z = (z ^ (z >> np.uint64(30))) * MIX_1
    z = (z ^ (z >> np.uint64(27))) * MIX_2
    return z ^ (z >> np.uint64(31))


@kernel
def pulse_key(seed, strip, pulse):
    """Where a pulse's sequence of random numbers starts."""
    key = mixed(np.uint64(seed) * GAMMA + np.uint64(strip))
    return mixed(key + np.uint64(pulse) * GAMMA)


@kernel
def uniform(key, draw):
    """Number `draw` of a sequence, uniform in [0, 1)."""
    return np.float64(mixed(key + np.uint64(draw + 1) * GAMMA) >> np.uint64(11)) * ULP


@kernel
def exponential(key, draw):
    """Number `draw` of a sequence, exponential with mean 1."""
    return -np.log(1.0 - uniform(key, draw))


@kernel
def normal_pair(key, draw):
    """Two independent standard normal numbers from draws `draw` and `draw` + 1 (Box & Muller 1958)."""
    radius = np.sqrt(2.0 * exponential(key, draw))
    angle = 2.0 * np.pi * uniform(key, draw + 1)
    return radius * np.cos(angle), radius * np.sin(angle)
