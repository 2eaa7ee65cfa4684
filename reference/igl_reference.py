"""libigl's Laplacian, mass matrices and harmonic field of one mesh, in the numbering of its file.

    igl_reference.py MESH OUT_FOLDER [--constraints FILE.csv]

writes to OUT_FOLDER, as .npy in float64:
  laplacian.npy          rows (i, j, L_ij), i <= j, sorted: L positive semi-definite, i.e. the negative of igl.cotmatrix
  mass_barycentric.npy   n lumped masses
  mass_voronoi.npy       n lumped masses, libigl's hybrid for obtuse triangles
  constraints.npy        rows (vertex, g_1 .. g_k): those of the file, or the default ones
  field.npy              n x k: igl.harmonic(V, F, b, bc, 1)
and prints one JSON object: versions, sizes, the mesh's sha256. libigl knows neither zero-area triangles nor vertices
without triangles: both are taken out first; such vertices have mass 0, field 0 and no row. Constraints: CSV as lapbench
takes them, `vertex, g_1 .. g_k` per line, 0-based.
"""

import argparse
import json
import pathlib
import platform

import igl
import numpy as np
import scipy
import scipy.sparse as sparse

import default_constraints
import mesh_files


def versions():
    import importlib.metadata

    return {"python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__,
            "libigl": importlib.metadata.version("libigl")}


def laplacian(mesh):
    """-igl.cotmatrix: positive semi-definite, L_ij = -(cot a + cot b)/2."""
    return (-igl.cotmatrix(mesh.positions, mesh.triangles)).tocsr()


def masses(mesh):
    """Lumped masses: (barycentric, Voronoi)."""
    kinds = (igl.MASSMATRIX_TYPE_BARYCENTRIC, igl.MASSMATRIX_TYPE_VORONOI)
    return tuple(igl.massmatrix(mesh.positions, mesh.triangles, kind).diagonal() for kind in kinds)


def harmonic(mesh, vertices, values):
    """The field that is harmonic off `vertices`, n x k."""
    return igl.harmonic(mesh.positions, mesh.triangles, np.asarray(vertices, np.int64), values, 1)


def spread(values, used, count):
    """Values of the compacted vertices in the file's numbering, 0 elsewhere."""
    all_values = np.zeros((count, *values.shape[1:]))
    all_values[used] = values
    return all_values


def read_constraints(path, mesh, used):
    """Vertices in the compacted numbering, and values. libigl answers nonsense where a component has none: refused."""
    rows = np.loadtxt(path, delimiter=",", ndmin=2)
    vertices = np.searchsorted(used, rows[:, 0])
    if (vertices == len(used)).any() or (used[vertices] != rows[:, 0]).any():
        raise ValueError(f"{path}: a constrained vertex is on no triangle of positive area")
    count, component = default_constraints.components(mesh)
    if len(np.unique(component[vertices])) < count:
        raise ValueError(f"{path}: a component has no constrained vertex")
    order = np.argsort(vertices)
    return vertices[order], rows[order, 1:]


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("mesh", type=pathlib.Path)
    arguments.add_argument("out", type=pathlib.Path)
    arguments.add_argument("--constraints", type=pathlib.Path)
    options = arguments.parse_args()

    original = mesh_files.read(options.mesh)
    mesh, used = mesh_files.compacted(original)
    count = len(original.positions)
    if options.constraints:
        vertices, values = read_constraints(options.constraints, mesh, used)
    else:
        vertices = default_constraints.choose(mesh)
        values = default_constraints.values(mesh, vertices)

    upper = sparse.triu(laplacian(mesh)).tocoo()
    entries = np.column_stack([used[upper.row], used[upper.col], upper.data])
    barycentric, voronoi = masses(mesh)
    arrays = {
        "laplacian": entries[np.lexsort((entries[:, 1], entries[:, 0]))],
        "mass_barycentric": spread(barycentric, used, count),
        "mass_voronoi": spread(voronoi, used, count),
        "constraints": np.column_stack([used[vertices], values]),
        "field": spread(harmonic(mesh, vertices, values), used, count),
    }
    options.out.mkdir(parents=True, exist_ok=True)
    for name, array in arrays.items():
        np.save(options.out / f"{name}.npy", np.ascontiguousarray(array, np.float64))
    print(json.dumps({"versions": versions(), "sha256": mesh_files.checksum(original), "vertices": count,
                      "triangles": len(original.triangles), "zero_area": int(mesh_files.zero_area(original).sum()),
                      "unreferenced": count - len(used)}))


if __name__ == "__main__":
    main()
