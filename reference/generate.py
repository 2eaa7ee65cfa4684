"""Writes the golden values: small samples of what libigl and Open3D compute, one JSON file per mesh, and their manifest.

    generate.py [DATA_FOLDER]       (default: $LAPBENCH_DATA; without it only golden/meshes)

Each golden/<mesh>.json holds the mesh's checksum, the versions of the tools, and
  laplacian   whole rows i of L: [i, j, L_ij, limit]; |difference| <= limit * max(L_ii, L_jj) is expected
  trace       sum of L_ii, and
  quadratic   x' L x for x_i = sin(i + 1) over the vertices of the file: these two depend on every entry, and agree to
              `limit` of the trace
  mass        [i, barycentric, Voronoi, limit], the limit being relative; total_area
  harmonic    limit of a direct f64 solver, relative to the largest |g|; constraints [vertex, g_1 .. g_k], samples [vertex, u_1 .. u_k] of igl.harmonic
  open3d      area of the whole mesh; for some closed meshes as-rigid-as-possible deformation: handles [vertex, x, y, z],
              positions [vertex, x, y, z] after 1 and after 5 iterations
  pipelines   for the same meshes: igl_arap, positions [vertex, x, y, z] after the start and 5 iterations of libigl's arap for
              the same handles; distances [vertex, libigl, potpourri3d] from vertex `source`
in the numbering of the file. golden/manifest.json has the sha256 of every golden file.
"""

import hashlib
import json
import os
import pathlib
import sys

import numpy as np

import default_constraints
import igl_reference
import mesh_files
import open3d_reference
import pipelines_reference

GOLDEN = pathlib.Path(__file__).resolve().parent / "golden"
# libigl computes from edge lengths and loses about eps / angle^2 of a triangle's area: on real meshes its entries are off
# by up to 0.5 of that. Above about a degree the limit is what rounding alone may do.
FAT_LIMIT, THIN_FACTOR = 1e-12, 2.0
# Where eps / angle^2 is above 1e-9, rounding alone makes L uncertain by more than harmonic fields may be off otherwise: on
# the 871K-triangle dragon libigl's field is 2.4e-9 off the solution of its own equations.
UNCERTAIN_ANGLE, CERTAIN_FIELD, UNCERTAIN_FIELD = np.radians(0.03), 1e-9, 1e-8
ROWS = 16  # spread over the mesh; a few more lie where mistakes show
SAMPLES = 20
# Closed meshes, since Open3D doubles the weights of boundary edges; small ones, since it factors in every call.
ARAP_MESHES = {"sphere_2", "blob_2", "femur_8k", "smpl_woman_14k"}
ARAP_HANDLES = 10


def sampled_vertices(mesh, angles):
    """Spread over the numbering, and where mistakes show: thin triangles, obtuse corners."""
    even = np.linspace(0, len(mesh.positions) - 1, ROWS).astype(int)
    thin = mesh.triangles[np.argsort(angles.min(axis=1))[: ROWS // 4], 0]
    obtuse = np.argmax(angles.max(axis=1) * (angles.min(axis=1) > np.radians(1)))
    return np.unique(np.concatenate([even, thin, mesh.triangles[obtuse]]))


def vertex_limits(mesh, angles):
    """Per vertex: how far libigl's row may be off, by its thinnest triangle."""
    thinnest = np.full(len(mesh.positions), np.pi)
    np.minimum.at(thinnest, mesh.triangles.ravel(), np.repeat(angles.min(axis=1), 3))
    return np.maximum(FAT_LIMIT, THIN_FACTOR * np.finfo(float).eps / thinnest**2)


def laplacian_rows(matrix, vertices, limits, used):
    rows = []
    for i in vertices:
        row = matrix[int(i)].tocoo()
        order = np.argsort(row.col)
        rows += [[int(used[i]), int(used[j]), float(value), float(limits[i])]
                 for j, value in zip(row.col[order], row.data[order])]
    return rows


def harmonic_samples(mesh, used, angles):
    vertices = default_constraints.choose(mesh)
    values = default_constraints.values(mesh, vertices)
    field = igl_reference.harmonic(mesh, vertices, values)
    sampled = spread(np.setdiff1d(np.arange(len(field)), vertices))
    return {"limit": UNCERTAIN_FIELD if angles.min() < UNCERTAIN_ANGLE else CERTAIN_FIELD,
            "constraints": [[int(used[v]), *map(float, g)] for v, g in zip(vertices, values)],
            "samples": [[int(used[v]), *map(float, field[v])] for v in sampled]}


def arap_handles(mesh):
    """Ten handles, where they go (up to a tenth of the mesh's size), and some other vertices."""
    vertices = default_constraints.choose(mesh)[:: default_constraints.COUNT // ARAP_HANDLES]
    size = np.linalg.norm(np.ptp(mesh.positions, axis=0))
    targets = mesh.positions[vertices] + 0.1 * size * default_constraints.values(mesh, vertices)[:, 1:]
    return vertices, targets, spread(np.setdiff1d(np.arange(len(mesh.positions)), vertices))


def arap_samples(mesh):
    """Where some free vertices go."""
    vertices, targets, sampled = arap_handles(mesh)
    samples = {"handles": [[int(v), *map(float, x)] for v, x in zip(vertices, targets)]}
    for iterations in (1, 5):
        deformed = open3d_reference.deform(
            open3d_reference.from_arrays(mesh.positions, mesh.triangles), vertices, targets, iterations)
        samples[f"after_{iterations}"] = [[int(v), *map(float, deformed[v])] for v in sampled]
    return samples


def pipeline_samples(mesh):
    """The handles of `arap_samples` once more, and distances from the first vertex."""
    vertices, targets, sampled = arap_handles(mesh)
    order = np.argsort(vertices)
    deformed = pipelines_reference.igl_arap(mesh, vertices[order], targets[order], 5)
    source = 0
    libigl = pipelines_reference.igl_heat(mesh, source)
    potpourri, version = pipelines_reference.potpourri(mesh, source)
    return {"potpourri3d": version, "source": source,
            "igl_arap": [[int(v), *map(float, deformed[v])] for v in sampled],
            "distances": [[int(v), float(libigl[v]), float(potpourri[v])] for v in sampled]}


def spread(indices):
    """At most `SAMPLES` of them, evenly."""
    return indices[np.linspace(0, len(indices) - 1, min(SAMPLES, len(indices))).astype(int)]


def golden_values(path, name):
    original = mesh_files.read(path)
    mesh, used = mesh_files.compacted(original)
    angles = mesh_files.corner_angles(mesh)
    matrix = igl_reference.laplacian(mesh)
    vertices, limits = sampled_vertices(mesh, angles), vertex_limits(mesh, angles)
    barycentric, voronoi = igl_reference.masses(mesh)
    wave = np.sin(used + 1.0)
    whole = open3d_reference.from_arrays(original.positions, original.triangles)
    return {
        "mesh": {"file": name, "sha256": mesh_files.checksum(original), "vertices": len(original.positions),
                 "triangles": len(original.triangles), "zero_area": int(mesh_files.zero_area(original).sum()),
                 "unreferenced": len(original.positions) - len(used)},
        "tools": {**igl_reference.versions(), **open3d_reference.versions()},
        "limit": float(limits @ matrix.diagonal() / matrix.diagonal().sum()),
        "trace": float(matrix.diagonal().sum()),
        "quadratic": float(wave @ (matrix @ wave)),
        "total_area": float(barycentric.sum()),
        "laplacian": laplacian_rows(matrix, vertices, limits, used),
        "mass": [[int(used[i]), float(barycentric[i]), float(voronoi[i]), float(limits[i])]
                 for i in vertices],
        "harmonic": harmonic_samples(mesh, used, angles),
        "open3d": {"area": whole.get_surface_area(), **(arap_samples(mesh) if path.stem in ARAP_MESHES else {})},
        **({"pipelines": pipeline_samples(mesh)} if path.stem in ARAP_MESHES else {}),
    }


def write(values, path):
    """One line per key, one line per row of a table: small, and a change shows as a small difference."""
    def text(value):
        if isinstance(value, list):
            return "[\n" + ",\n".join(json.dumps(row, separators=(",", ":")) for row in value) + "\n]"
        if isinstance(value, dict) and any(isinstance(member, list) for member in value.values()):
            return "{" + ",\n".join(f"{json.dumps(key)}: {text(member)}" for key, member in value.items()) + "}"
        return json.dumps(value)

    path.write_text("{\n" + ",\n".join(f"{json.dumps(key)}: {text(value)}" for key, value in values.items()) + "\n}\n")


def sources(data):
    """(path, name) of each mesh; the name is what the tests look for below $LAPBENCH_DATA or golden/."""
    yield from ((path, f"golden/meshes/{path.name}") for path in sorted((GOLDEN / "meshes").glob("*.obj")))
    if data:
        for folder in ("meshes", "sequences", "bad"):
            yield from ((path, f"{folder}/{path.name}") for path in sorted((data / folder).glob("*.ply")))


def write_manifest():
    """Every golden file with its sha256. The tools stand in each file, since files may come from different runs."""
    files = sorted(path for path in GOLDEN.rglob("*") if path.is_file() and path.name != "manifest.json")
    sums = {str(path.relative_to(GOLDEN)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    (GOLDEN / "manifest.json").write_text(json.dumps(sums, indent=1) + "\n")


def main():
    data = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("LAPBENCH_DATA")
    for path, name in sources(pathlib.Path(data) if data else None):
        write(golden_values(path, name), GOLDEN / f"{path.stem}.json")
        print(name, file=sys.stderr)
    write_manifest()


if __name__ == "__main__":
    main()
