"""How people move: minimum-jerk steps between held poses, slow wandering, and the tremor of a hand in the air.

Flash and Hogan, "The coordination of arm movements", Journal of Neuroscience 5(7), 1985: a reach from a to b in time T
goes a + (b - a)(10 s^3 - 15 s^4 + 6 s^5), s = t / T. Physiological hand tremor lies between 8 and 12 Hz.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from turns import slerp


def smooth_part(t: np.ndarray, start: float, end: float) -> np.ndarray:
    """Minimum-jerk part of the way from 0 before ``start`` to 1 after ``end`` (s)."""
    s = np.clip((t - start) / (end - start), 0.0, 1.0)
    return s * s * s * (10 - 15 * s + 6 * s * s)


def through(t: np.ndarray, keys: list[tuple[float, object]]) -> np.ndarray:
    """Values (n, ...) at times t (n,), passing by minimum-jerk steps from key to key (time in s, value)."""
    first = np.asarray(keys[0][1], dtype=float)
    out = np.tile(first, (len(t),) + (1,) * first.ndim)
    shape = (len(t),) + (1,) * first.ndim
    for (start, a), (end, b) in pairwise(keys):
        out = out + smooth_part(t, start, end).reshape(shape) * (
            np.asarray(b, dtype=float) - np.asarray(a, dtype=float)
        )
    return out


def turned_through(t: np.ndarray, keys: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """Quaternions (n, 4) at times t, passing by minimum-jerk steps from key to key."""
    out = np.tile(keys[0][1], (len(t), 1))
    for (start, a), (end, b) in pairwise(keys):
        now = (t >= start) if end == keys[-1][0] else (t >= start) & (t < end)
        out[now] = slerp(a, b, smooth_part(t[now], start, end))
    return out


def mixed(t: np.ndarray, postures: dict[str, dict[str, float]], keys: list[tuple[float, str]]) -> dict[str, np.ndarray]:
    """Joint angles in rad over time from named postures in degrees, passing from one to the next."""
    names = sorted({name for posture in postures.values() for name in posture})
    track = through(t, [(when, [postures[key].get(n, 0.0) for n in names]) for when, key in keys])
    return {name: np.radians(track[:, k]) for k, name in enumerate(names)}


class Restless:
    """Seeded sums of sines: what never keeps still in a living hand.

    Parameters
    ----------
    seed
        Same seed, same motion.
    t
        Times in s, (n,).
    """

    def __init__(self, seed: int, t: np.ndarray) -> None:
        self.random = np.random.default_rng(seed)
        self.t = t

    def wander(self, size: float, low: float = 0.08, high: float = 0.45, waves: int = 5) -> np.ndarray:
        """Slow drift (n,) whose root mean square is about ``size``, frequencies ``low`` to ``high`` in Hz."""
        f = self.random.uniform(low, high, waves)
        phase = self.random.uniform(0, 2 * np.pi, waves)
        weight = self.random.uniform(0.6, 1.4, waves)
        weight *= size * np.sqrt(2.0 / np.sum(weight**2))
        return np.sin(2 * np.pi * f * self.t[:, None] + phase) @ weight

    def tremor(self, size: float) -> np.ndarray:
        """Tremor (n, 3) between 8 and 12 Hz, ``size`` the root mean square along each axis."""
        return np.stack([self.wander(size, 8.0, 12.0, 7) for _ in range(3)], axis=1)

    def drift(self, size: float, low: float = 0.08, high: float = 0.45) -> np.ndarray:
        """Slow drift (n, 3)."""
        return np.stack([self.wander(size, low, high) for _ in range(3)], axis=1)


def softened(values: np.ndarray, width: float) -> np.ndarray:
    """Moving average of (n,) with a Gaussian weight of ``width`` samples; the ends are held."""
    reach = int(4 * width)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    padded = np.r_[np.full(reach, values[0]), values, np.full(reach, values[-1])]
    return np.convolve(padded, weight / weight.sum(), mode="valid")
