"""What Open3D makes of a mesh: its reading of the file, its area, and as-rigid-as-possible deformation.

    open3d_reference.py MESH OUT_FOLDER [--handles FILE.csv --iterations N]

writes to OUT_FOLDER, as .npy in float64:
  positions.npy   n x 3 as Open3D reads the file
  triangles.npy   m x 3
  deformed.npy    n x 3: deform_as_rigid_as_possible after N iterations (with --handles: rows `vertex, x, y, z`)
and prints one JSON object: versions, sizes, surface area. Open3D clamps the weight of each edge at zero and takes the
mean of its two cotangents, dividing by one at a boundary: boundary weights are twice those of L. It moves the handles
after the first local step, so the first iteration has R = I: its result is x + u, u the field that is harmonic for the
clamped weights off the handles, where it is their displacement.
"""

import argparse
import json
import pathlib
import platform

import numpy as np
import open3d


def versions():
    return {"python": platform.python_version(), "numpy": np.__version__, "open3d": open3d.__version__}


def read(path):
    mesh = open3d.io.read_triangle_mesh(str(path))
    if not mesh.has_triangles():
        raise ValueError(f"{path}: Open3D reads no triangles")
    return mesh


def from_arrays(positions, triangles):
    return open3d.geometry.TriangleMesh(open3d.utility.Vector3dVector(positions),
                                        open3d.utility.Vector3iVector(np.asarray(triangles, np.int32)))


def deform(mesh, vertices, targets, iterations):
    """Positions after `iterations` of local and global step, energy Spokes."""
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        deformed = mesh.deform_as_rigid_as_possible(
            open3d.utility.IntVector([int(v) for v in vertices]), open3d.utility.Vector3dVector(targets), max_iter=iterations)
    return np.asarray(deformed.vertices)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("mesh", type=pathlib.Path)
    arguments.add_argument("out", type=pathlib.Path)
    arguments.add_argument("--handles", type=pathlib.Path)
    arguments.add_argument("--iterations", type=int, default=1)
    options = arguments.parse_args()
    mesh = read(options.mesh)
    arrays = {"positions": np.asarray(mesh.vertices), "triangles": np.asarray(mesh.triangles)}
    if options.handles:
        rows = np.loadtxt(options.handles, delimiter=",", ndmin=2)
        arrays["deformed"] = deform(mesh, rows[:, 0], rows[:, 1:4], options.iterations)
    options.out.mkdir(parents=True, exist_ok=True)
    for name, array in arrays.items():
        np.save(options.out / f"{name}.npy", np.ascontiguousarray(array, np.float64))
    print(json.dumps({"versions": versions(), "vertices": len(arrays["positions"]), "triangles": len(arrays["triangles"]),
                      "area": mesh.get_surface_area()}))


if __name__ == "__main__":
    main()
