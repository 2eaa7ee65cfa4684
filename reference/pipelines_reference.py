"""What libigl, Open3D and potpourri3d make of a mesh by whole pipelines: deformation by handles, distances from a vertex.

    pipelines_reference.py MESH OUT_FOLDER --handles FILE.csv --iterations N --source V

writes to OUT_FOLDER, as .npy in float64:
  open3d_arap.npy   n x 3: deform_as_rigid_as_possible, N + 1 iterations, of which the first has R = I
  igl_arap.npy      n x 3: N iterations of arap with SPOKES energy from x + u, u the harmonic field of the displacements
  igl_heat.npy      n distances from vertex V by heat_geodesics
  potpourri3d.npy   n distances by MeshHeatMethodDistanceSolver with use_robust=False; absent where it is not installed
and prints one JSON object with the versions. The mesh must have no zero-area triangles and no vertices without triangles.
Handles: rows `vertex, x, y, z`, ascending by vertex.
"""

import argparse
import importlib.metadata
import json
import pathlib

import igl
import numpy as np

import igl_reference
import mesh_files
import open3d_reference


def igl_arap(mesh, vertices, targets, iterations):
    data = igl.ARAPData()
    data.energy, data.max_iter = igl.ARAP_ENERGY_TYPE_SPOKES, iterations
    igl.arap_precomputation(mesh.positions, mesh.triangles, 3, vertices.astype(np.int32), data)
    start = mesh.positions + igl_reference.harmonic(mesh, vertices, targets - mesh.positions[vertices])
    return igl.arap_solve(targets, data, start)


def igl_heat(mesh, source):
    data = igl.HeatGeodesicsData()
    igl.heat_geodesics_precompute(mesh.positions, mesh.triangles, data)
    return igl.heat_geodesics_solve(data, np.array([source], np.int32))


def potpourri(mesh, source):
    """Distances and the version; None where it is not installed."""
    try:
        import potpourri3d
    except ImportError:
        return None, None
    solver = potpourri3d.MeshHeatMethodDistanceSolver(mesh.positions, mesh.triangles, use_robust=False)
    return solver.compute_distance(source), importlib.metadata.version("potpourri3d")


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("mesh", type=pathlib.Path)
    arguments.add_argument("out", type=pathlib.Path)
    arguments.add_argument("--handles", type=pathlib.Path, required=True)
    arguments.add_argument("--iterations", type=int, required=True)
    arguments.add_argument("--source", type=int, required=True)
    options = arguments.parse_args()
    mesh = mesh_files.read(options.mesh)
    rows = np.loadtxt(options.handles, delimiter=",", ndmin=2)
    vertices, targets = rows[:, 0].astype(np.int64), np.ascontiguousarray(rows[:, 1:4])
    distances, version = potpourri(mesh, options.source)
    arrays = {
        "open3d_arap": open3d_reference.deform(open3d_reference.from_arrays(mesh.positions, mesh.triangles), vertices,
                                               targets, options.iterations + 1),
        "igl_arap": igl_arap(mesh, vertices, targets, options.iterations),
        "igl_heat": igl_heat(mesh, options.source),
    }
    if distances is not None:
        arrays["potpourri3d"] = distances
    options.out.mkdir(parents=True, exist_ok=True)
    for name, array in arrays.items():
        np.save(options.out / f"{name}.npy", np.ascontiguousarray(array, np.float64))
    versions = {**igl_reference.versions(), **open3d_reference.versions(), "potpourri3d": version}
    print(json.dumps({"versions": versions, "potpourri3d": distances is not None}))


if __name__ == "__main__":
    main()
