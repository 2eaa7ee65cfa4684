"""Writes the small meshes of golden/meshes: `generated_meshes.py FOLDER`. 17 digits, so that every reader gets the same
doubles."""

import math
import pathlib
import sys

import numpy as np


def sphere(level):
    """Icosahedron, each triangle split in four `level` times, new vertices pushed onto the unit sphere."""
    golden = (1 + math.sqrt(5)) / 2
    vertices = [(x, y, 0.0) for x in (-1, 1) for y in (-golden, golden)]
    vertices = vertices + [(0.0, x, y) for x, y, _ in vertices] + [(y, 0.0, x) for x, y, _ in vertices]
    points = [np.array(v) / math.hypot(1, golden) for v in vertices]
    near = 1.1  # edges of the icosahedron in the unit sphere are 1.05 long, other pairs at least 1.7
    triangles = []
    for a in range(12):
        for b in range(a + 1, 12):
            for c in range(b + 1, 12):
                if max(np.linalg.norm(points[i] - points[j]) for i, j in ((a, b), (b, c), (c, a))) < near:
                    outward = np.linalg.det([points[a], points[b], points[c]]) > 0
                    triangles.append((a, b, c) if outward else (a, c, b))
    for _ in range(level):
        triangles = _split(points, triangles)
    return points, triangles


def _split(points, triangles):
    middles = {}

    def middle(i, j):
        key = (min(i, j), max(i, j))
        if key not in middles:
            middles[key] = len(points)
            points.append((points[i] + points[j]) / np.linalg.norm(points[i] + points[j]))
        return middles[key]

    split = []
    for a, b, c in triangles:
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        split += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return split


def grid(n, height=lambda x, y: 0.0):
    """n x n squares of the unit square, each cut in two right triangles, lifted by `height`."""
    points = [np.array([i / n, j / n, height(i / n, j / n)]) for j in range(n + 1) for i in range(n + 1)]
    triangles = []
    for j in range(n):
        for i in range(n):
            a = j * (n + 1) + i
            b, c, d = a + 1, a + n + 2, a + n + 1
            triangles += [(a, b, c), (a, c, d)]
    return points, triangles


def hills(n):
    """A stretched, lifted grid: obtuse triangles, negative weights and a boundary."""
    points, triangles = grid(n, lambda x, y: 0.3 * math.sin(7 * x) * math.cos(5 * y))
    return [point * (1.0, 3.0, 1.0) for point in points], triangles


def blob(level):
    """A closed, flattened and dented sphere: edges whose opposite angles sum to more than 180 degrees."""
    points, triangles = sphere(level)
    return [(1 + 0.2 * math.sin(6 * p[0] + 4 * p[1])) * p * (1.0, 2.5, 0.4) for p in points], triangles


def pieces():
    """Two components, one vertex that no triangle uses, and one triangle of zero area."""
    points, triangles = hills(6)
    first = len(points)
    points += [np.array([5.0, 5.0, 5.0])]
    more, ball = sphere(1)
    points += [point + (3.0, 0.0, 0.0) for point in more]
    triangles += [tuple(corner + first + 1 for corner in triangle) for triangle in ball]
    points += [points[0] + 0.5 * (points[1] - points[0])]
    return points, triangles + [(0, 1, len(points) - 1)]


def write_obj(path, points, triangles):
    lines = ["v " + " ".join(f"{x:.17g}" for x in point) for point in points]
    lines += ["f " + " ".join(str(corner + 1) for corner in triangle) for triangle in triangles]
    pathlib.Path(path).write_text("\n".join(lines) + "\n")


MESHES = {"sphere_2": lambda: sphere(2), "grid_12": lambda: grid(12), "hills_12": lambda: hills(12), "blob_2": lambda: blob(2),
          "pieces": pieces}

if __name__ == "__main__":
    for name, make in MESHES.items():
        write_obj(pathlib.Path(sys.argv[1]) / f"{name}.obj", *make())
