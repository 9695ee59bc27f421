"""Does openumi's tasks with Python and SciPy, on the data that `umi-bench write` left in a folder.

    python peers.py FOLDER

Prints one JSON object a line, as `umi-bench time` does.
"""

import json
import re
import statistics
import sys
import time
from pathlib import Path

import numpy as np
import scipy
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

ROUNDS = 21
ROUND_SECONDS = 0.02


NUMBER = rb"([+-]?)[ *]*(\d*\.\d*)"
LINE = re.compile(rb"^[ *]*" + rb"[ *]*".join([NUMBER] * 3) + rb"\s*$", re.MULTILINE)


def read(text):
    """Lines of three numbers, and nothing else: a script."""
    coordinates = []
    for fields in LINE.finditer(text):
        sx, x, sy, y, sz, z = fields.groups()
        coordinates += [float(sx + x), float(sy + y), float(sz + z)]
    return coordinates


def sphere(points):
    """Orthogonal least squares with MINPACK, from the linear start; covariance from J."""
    centroid = points.mean(axis=0)
    local = points - centroid
    rows = np.column_stack([2 * local, np.ones(len(local))])
    *center, h = np.linalg.lstsq(rows, (local**2).sum(axis=1), rcond=None)[0]
    start = [*center, np.sqrt(h + np.dot(center, center))]

    def residuals(at):
        return np.linalg.norm(local - at[:3], axis=1) - at[3]

    def jacobian(at):
        away = at[:3] - local
        away /= np.linalg.norm(away, axis=1)[:, None]
        return np.column_stack([away, -np.ones(len(local))])

    fit = least_squares(residuals, start, jac=jacobian, method="lm")
    variance = 2 * fit.cost / (len(local) - 4)
    unit = np.linalg.inv(fit.jac.T @ fit.jac)
    return [*(fit.x[:3] + centroid), fit.x[3], *np.sqrt(variance * np.diag(unit)[:3])]


def registration(pairs):
    """Rotation of the centred pairs by `Rotation.align_vectors`."""
    source, target = pairs[:, :3], pairs[:, 3:]
    p, q = source.mean(axis=0), target.mean(axis=0)
    rotation = Rotation.align_vectors(target - q, source - p)[0].as_matrix()
    return [*rotation.ravel(), *(q - rotation @ p)]


def point(readings, ball):
    """Offset and direction with MINPACK from a beam straight down; uncertainties from J."""
    center, radius = ball[:3], ball[3]
    axes, gamma = readings[:, :3] - center, readings[:, 3:]
    down = np.array([0.0, 0.0, -1.0])
    start = [*-(axes + gamma * down).mean(axis=0) - 0.75 * radius * down, 0.0, 0.0]

    def beam(at):
        along = np.array([at[3], at[4], -1.0])
        length = np.linalg.norm(along)
        a = along / length
        return a, (np.eye(3)[:2] - np.outer(a[:2], a)) / length

    def residuals(at):
        return np.linalg.norm(axes + at[:3] + gamma * beam(at)[0], axis=1) - radius

    def jacobian(at):
        a, turns = beam(at)
        normal = axes + at[:3] + gamma * a
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        return np.column_stack([normal, gamma * (normal @ turns.T)])

    fit = least_squares(residuals, start, jac=jacobian, method="lm", xtol=1e-15, ftol=1e-15)
    unit = np.linalg.inv(fit.jac.T @ fit.jac) * 2 * fit.cost / (len(gamma) - 5)
    a, turns = beam(fit.x)
    turned = np.diag(turns.T @ unit[3:, 3:] @ turns)
    return [*fit.x[:3], *a, *np.sqrt(np.diag(unit)[:3]), *np.sqrt(turned)]


def measure(task, by, work, size=None):
    """Rounds of repeated work; the median counts."""

    def repeat(times):
        start = time.perf_counter()
        for _ in range(times):
            work()
        return time.perf_counter() - start

    times = 1
    while repeat(times) < ROUND_SECONDS:
        times *= 2
    rounds = [repeat(times) * 1e9 / times for _ in range(ROUNDS)]
    line = {
        "task": task,
        "by": by,
        "bytes": size,
        "median_ns": statistics.median(rounds),
        "min_ns": min(rounds),
        "max_ns": max(rounds),
        "answer": [float(value) for value in work()],
    }
    print(json.dumps(line), flush=True)


def main():
    folder = Path(sys.argv[1])

    def load(name):
        return np.loadtxt(folder / f"{name}.csv", delimiter=",")

    text = (folder / "session.txt").read_bytes()
    by = f"Python {sys.version.split()[0]} re"
    measure("DPRNT text of a session", by, lambda: read(text), len(text))
    by = f"SciPy {scipy.__version__}"
    for n in (5, 500):
        points = load(f"sphere-{n}")
        measure(f"sphere of {n} points", by, lambda points=points: sphere(points))
    for n in (3, 50):
        pairs = load(f"pairs-{n}")
        measure(f"registration of {n} pairs", by, lambda pairs=pairs: registration(pairs))
    readings, ball = load("readings-100"), load("ball")
    task = "calibration of a point sensor by 100 readings"
    measure(task, by, lambda: point(readings, ball))


if __name__ == "__main__":
    main()
