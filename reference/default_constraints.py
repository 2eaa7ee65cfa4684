"""What `harmonic` is given when only a mesh is: constrained vertices and their values."""

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.csgraph as csgraph

COUNT = 50
ANGLE = np.radians(60)


def choose(mesh):
    """Ascending vertex indices of a compacted mesh: `COUNT` by farthest-point sampling (start: the smallest x, then y,
    z; ties: the lowest index), then the smallest vertex of each component that has none."""
    points = mesh.positions
    first = smallest(points, np.arange(len(points)))
    chosen, distance = [first], squared_distance(points, first)
    while len(chosen) < min(COUNT, len(points)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, squared_distance(points, chosen[-1]))
    _, component = components(mesh)
    have = set(component[chosen])
    for label in sorted(set(component) - have):
        chosen.append(smallest(points, np.flatnonzero(component == label)))
    return np.array(sorted(chosen))


def values(mesh, vertices):
    """Unit quaternions (w, x, y, z): the product of the turns by 60 degrees times the place in the box along x, y, z."""
    low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
    extent = np.where(high > low, high - low, 1.0)
    place = np.where(high > low, 2 * (mesh.positions[vertices] - low) / extent - 1, 0.0)
    product = None
    for axis in range(3):
        turn = np.zeros((len(vertices), 4))
        turn[:, 0] = np.cos(ANGLE * place[:, axis] / 2)
        turn[:, 1 + axis] = np.sin(ANGLE * place[:, axis] / 2)
        product = turn if product is None else multiply(product, turn)
    return product


def multiply(p, q):
    """Hamilton product, row by row."""
    w, v = p[:, :1], p[:, 1:]
    x, u = q[:, :1], q[:, 1:]
    return np.hstack([w * x - (v * u).sum(axis=1, keepdims=True), w * u + x * v + np.cross(v, u)])


def components(mesh):
    """Number of components (triangles joined through shared vertices) and the label of each vertex."""
    t, n = mesh.triangles, len(mesh.positions)
    rows, columns = np.concatenate([t[:, 0], t[:, 1]]), np.concatenate([t[:, 1], t[:, 2]])
    return csgraph.connected_components(sparse.coo_matrix((np.ones(len(rows)), (rows, columns)), (n, n)), directed=False)


def smallest(points, among):
    """The index in `among` of the smallest x, then y, then z, then index."""
    p = points[among]
    return int(among[np.lexsort((among, p[:, 2], p[:, 1], p[:, 0]))[0]])


def squared_distance(points, to):
    return ((points - points[to]) ** 2).sum(axis=1)
