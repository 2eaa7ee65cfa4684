"""Peers that take a mesh instead of a matrix: as-rigid-as-possible deformation and heat-method distances.

A solver has `precision`, `accuracy`, `kind` (the protocol's problem that it takes), `convention` (in what its answer differs by
design, see the README here), `details()`, and
  prepare_mesh(problem)    everything before the first input; problem.positions, .triangles, .handles, .iterations
  solve(b)                 one answer, one row per vertex
"""

import numpy as np
import scipy.sparse as sparse

from problem import Refusal, read
from solvers import Solver, load


class MeshProblem:
    """A mesh with what the workload fixes before the first input."""

    def __init__(self, description):
        self.kind = description["kind"]
        mesh = description["mesh"]
        self.positions = np.ascontiguousarray(read(mesh["positions"], "<f8"))
        self.triangles = read(mesh["triangles"], "<u4").astype(np.int64)
        self.vertices = len(self.positions)
        self.iterations = description.get("iterations")
        self.handles = None
        if "handles" in description:
            self.handles = read(description["handles"], "<u4").ravel().astype(np.int64)
        self.check()

    def check(self):
        """These libraries divide by areas and factorise every vertex: what they cannot take is refused, not passed on."""
        p = self.positions[self.triangles]
        double_area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
        longest = np.max([np.sum((p[:, i] - p[:, j]) ** 2, axis=1) for i, j in ((0, 1), (1, 2), (2, 0))], axis=0)
        if not (double_area > 1e-8 * longest).all():
            raise Refusal("unsupported", "takes no triangles of zero area")
        if len(np.unique(self.triangles)) < self.vertices:
            raise Refusal("unsupported", "takes no vertices without triangles")

    @property
    def inputs(self):
        return self.vertices if self.handles is None else len(self.handles)

    @property
    def closed(self):
        edges = np.sort(np.concatenate([self.triangles[:, [0, 1]], self.triangles[:, [1, 2]], self.triangles[:, [2, 0]]]))
        return (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


class IglArap(Solver):
    """libigl's arap with SPOKES energy. Its start is the same as everybody's: x + the harmonic field of the displacements."""

    kind, precision, convention = "arap", "f32", "libigl"  # rotations are fitted in f32

    def __init__(self, threads, tolerance):
        super().__init__(threads, tolerance)
        self.igl, self.version = load("igl", "libigl")
        self.threads = 1

    def details(self):
        return {"version": f"libigl {self.version}", "call": "min_quad_with_fixed_solve, arap_solve, SPOKES",
                "convention": self.convention}

    def prepare_mesh(self, problem):
        igl, self.problem = self.igl, problem
        self.data = igl.ARAPData()
        self.data.energy, self.data.max_iter = igl.ARAP_ENERGY_TYPE_SPOKES, problem.iterations
        igl.arap_precomputation(problem.positions, problem.triangles, 3, problem.handles.astype(np.int32), self.data)
        self.start = igl.min_quad_with_fixed_data()
        none = sparse.csc_matrix((0, problem.vertices))
        igl.min_quad_with_fixed_precompute(-igl.cotmatrix(problem.positions, problem.triangles), problem.handles, none,
                                           True, self.start)
        self.zero, self.none = np.zeros((problem.vertices, 3)), np.zeros((0, 3))

    def solve(self, b):
        displacement = b - self.problem.positions[self.problem.handles]
        field = self.igl.min_quad_with_fixed_solve(self.start, self.zero, displacement, self.none)
        return self.igl.arap_solve(b, self.data, self.problem.positions + field)


class Open3dArap(Solver):
    """Open3D's deform_as_rigid_as_possible, energy Spokes. It keeps nothing between calls: every one factorises anew."""

    kind, convention = "arap", "open3d"

    def __init__(self, threads, tolerance):
        super().__init__(threads, tolerance)
        self.o3d, _ = load("open3d", "open3d-cpu")
        self.version = self.o3d.__version__

    def details(self):
        return {"version": f"open3d {self.version}", "call": "deform_as_rigid_as_possible, factorises in every call",
                "convention": self.convention}

    def prepare_mesh(self, problem):
        utility, self.problem = self.o3d.utility, problem
        self.mesh = self.o3d.geometry.TriangleMesh(utility.Vector3dVector(problem.positions),
                                                   utility.Vector3iVector(problem.triangles.astype(np.int32)))
        self.handles = utility.IntVector([int(v) for v in problem.handles])

    def solve(self, b):
        utility = self.o3d.utility
        with utility.VerbosityContextManager(utility.VerbosityLevel.Error):
            # Its first iteration has R = I: the start of everybody else.
            moved = self.mesh.deform_as_rigid_as_possible(self.handles, utility.Vector3dVector(b),
                                                          max_iter=self.problem.iterations + 1)
        return np.asarray(moved.vertices)


class IglHeat(Solver):
    """libigl's heat_geodesics: Voronoi masses; at boundaries a mean of two conditions, so only closed surfaces compare."""

    kind, convention = "geodesic", "libigl"

    def __init__(self, threads, tolerance):
        super().__init__(threads, tolerance)
        self.igl, self.version = load("igl", "libigl")
        self.threads = 1

    def details(self):
        return {"version": f"libigl {self.version}", "call": "heat_geodesics_solve", "convention": self.convention}

    def prepare_mesh(self, problem):
        if not problem.closed:
            raise Refusal("unsupported", "takes other boundary conditions than the rest: closed surfaces only")
        self.data = self.igl.HeatGeodesicsData()
        self.igl.heat_geodesics_precompute(problem.positions, problem.triangles, self.data)

    def solve(self, b):
        return self.igl.heat_geodesics_solve(self.data, np.flatnonzero(b[:, 0]).astype(np.int32))[:, None]


class Potpourri(Solver):
    """potpourri3d (geometry-central) on the mesh as it is."""

    kind, convention = "geodesic", "geometry-central"

    def __init__(self, threads, tolerance):
        super().__init__(threads, tolerance)
        self.module, self.version = load("potpourri3d")
        self.threads = 1

    def details(self):
        return {"version": f"potpourri3d {self.version}", "call": "MeshHeatMethodDistanceSolver, use_robust=False",
                "convention": self.convention}

    def prepare_mesh(self, problem):
        self.solver = self.module.MeshHeatMethodDistanceSolver(problem.positions, problem.triangles, use_robust=False)

    def solve(self, b):
        return self.solver.compute_distance_multisource(np.flatnonzero(b[:, 0]))[:, None]


MESH_SOLVERS = {
    "igl-arap": IglArap,
    "open3d-arap": Open3dArap,
    "igl-heat": IglHeat,
    "potpourri3d": Potpourri,
}
