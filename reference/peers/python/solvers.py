"""One class per solver. Libraries are imported when a solver is opened: a missing one is a row that says so.

A solver has `precision`, `accuracy` (what its answers are held to), `details()`, and
  prepare(matrix, order)   everything that depends on the matrix only; `order` is called between ordering and numbers
  update(matrix)           new values on the same pattern; where a library cannot, it starts again
  arrange(b)               b (n x k, row after row) in the layout that the library wants; not timed
  solve(b)                 the solution, n x k, in any layout
  iterations, factor_nonzeros
"""

import ctypes
import importlib
import importlib.metadata
import time

import numpy as np
import scipy.sparse as sparse

from problem import Refusal


def load(module, package=None):
    """The module and its version, or a refusal that names the package."""
    try:
        return importlib.import_module(module), importlib.metadata.version(package or module)
    except (ImportError, OSError) as error:
        raise Refusal("unavailable", f"{package or module} is not installed ({error}); run `cargo xtask setup --peers`")


class Solver:
    precision, accuracy = "f64", "direct"
    kind = "system"  # what problems it takes: systems and harmonic fields, or whole pipelines (meshes.py)
    iterations, factor_nonzeros = None, None

    def __init__(self, threads, tolerance):
        self.threads, self.tolerance = threads, tolerance

    def arrange(self, b):
        return b

    def update(self, matrix):
        self.prepare(matrix, lambda: None)


class IglMinQuad(Solver):
    """libigl's min_quad_with_fixed: min 1/2 x'Ax - b'x, factorised by Eigen. Harmonic fields are its own form of input:
    the whole Laplacian and the known rows."""

    def __init__(self, threads, tolerance):
        super().__init__(threads, tolerance)
        self.igl, self.version = load("igl", "libigl")
        self.threads = 1  # SimplicialLDLT has no threads

    def details(self):
        return {"version": f"libigl {self.version}", "call": "min_quad_with_fixed_precompute / _solve, pd"}

    def prepare(self, matrix, order):
        self.prepare_known(matrix, np.zeros(0, np.int64))

    def prepare_known(self, matrix, known):
        self.data = self.igl.min_quad_with_fixed_data()
        none = sparse.csc_matrix((0, matrix.shape[0]))
        self.igl.min_quad_with_fixed_precompute(matrix.tocsc(), known, none, True, self.data)
        self.n = matrix.shape[0]

    def arrange(self, b):
        return -b

    def solve(self, b):
        return self.igl.min_quad_with_fixed_solve(self.data, b, np.zeros((0, b.shape[1])), np.zeros((0, b.shape[1])))

    def solve_known(self, values):
        zero, none = np.zeros((self.n, values.shape[1])), np.zeros((0, values.shape[1]))
        return self.igl.min_quad_with_fixed_solve(self.data, zero, values, none)


class IglHarmonic(Solver):
    """libigl's harmonic as its users call it: one call assembles, factorises and solves, so that every solve is all of it."""

    def __init__(self, threads, tolerance):
        super().__init__(threads, tolerance)
        self.igl, self.version = load("igl", "libigl")
        self.threads = 1

    def details(self):
        return {"version": f"libigl {self.version}", "call": "harmonic(V, F, b, bc, 1): assembles and factorises in every solve"}

    def take_mesh(self, problem, whole):
        if problem.kind != "harmonic" or problem.mesh is None:
            raise Refusal("unsupported", "only harmonic fields of a mesh")
        if not whole:
            raise Refusal("unsupported", "vertices without a triangle of positive area: libigl's matrix would be singular")
        self.mesh, self.fixed = problem.mesh, problem.fixed
        return self.assembly_time()

    def assembly_time(self):
        """Median time of igl.cotmatrix alone over five calls, nanoseconds."""
        times = []
        for _ in range(5):
            start = time.perf_counter_ns()
            self.igl.cotmatrix(*self.mesh)
            times.append(time.perf_counter_ns() - start)
        return sorted(times)[2]

    def solve_known(self, values):
        return self.igl.harmonic(*self.mesh, self.fixed, values, 1)


class Pardiso(Solver):
    """MKL PARDISO through pypardiso: real symmetric positive definite, upper triangle, MKL's own choice of ordering
    (parallel nested dissection), no iterative refinement."""

    SPD, ANALYSE, FACTORISE, SOLVE = 2, 11, 22, 33
    # Numbered from 1. The first switches MKL's defaults off, so the ones that differ from 0 are repeated.
    parameters = {1: 1, 2: 3, 8: 0, 18: -1}
    NONZEROS = 18

    def __init__(self, threads, tolerance):
        super().__init__(threads, tolerance)
        self.module, self.version = load("pypardiso")
        self.solver = None

    def details(self):
        return {"version": f"MKL {importlib.metadata.version('mkl')}, pypardiso {self.version}",
                "iparm": str(self.parameters or "MKL's defaults: two steps of refinement")}

    def call(self, phase, b):
        """pypardiso's own call, less its copies of the matrix' indices and of the solution in every solve."""
        solver, error = self.solver, ctypes.c_int32(0)
        one, n, k = (ctypes.c_int32(value) for value in (1, b.shape[0], b.shape[1]))
        kind, phase, silent = (ctypes.c_int32(value) for value in (self.SPD, phase, 0))
        ref, integers, numbers = ctypes.byref, ctypes.POINTER(ctypes.c_int32), ctypes.POINTER(ctypes.c_double)
        solver._mkl_pardiso(
            solver.pt.ctypes.data_as(ctypes.POINTER(solver._pt_type[0])), ref(one), ref(one), ref(kind), ref(phase), ref(n),
            self.upper.data.ctypes.data_as(numbers), self.starts.ctypes.data_as(integers),
            self.columns.ctypes.data_as(integers), solver.perm.ctypes.data_as(integers), ref(k),
            solver.iparm.ctypes.data_as(integers), ref(silent), b.ctypes.data_as(numbers), self.x.ctypes.data_as(numbers),
            ref(error))
        if error.value != 0:
            raise Refusal("failed", f"PARDISO error {error.value}")
        return self.x

    def take(self, matrix):
        self.upper = sparse.triu(matrix, format="csr")
        self.upper.sort_indices()
        self.starts, self.columns = (a.astype(np.int32) + 1 for a in (self.upper.indptr, self.upper.indices))

    def prepare(self, matrix, order):
        if self.solver:
            self.solver.free_memory(everything=True)
        self.solver = self.module.PyPardisoSolver(mtype=self.SPD)
        self.solver.libmkl.MKL_Set_Num_Threads(self.threads)
        for parameter, value in self.parameters.items():
            self.solver.set_iparm(parameter, value)
        self.take(matrix)
        self.x = self.nothing = np.zeros((matrix.shape[0], 1), order="F")
        self.call(self.ANALYSE, self.nothing)
        order()
        self.call(self.FACTORISE, self.nothing)
        self.factor_nonzeros = int(self.solver.get_iparm(self.NONZEROS))

    def update(self, matrix):
        self.take(matrix)
        self.call(self.FACTORISE, self.nothing)

    def arrange(self, b):
        self.x = np.zeros(b.shape, order="F")
        return np.asfortranarray(b)

    def solve(self, b):
        return self.call(self.SOLVE, b)


class PardisoRefined(Pardiso):
    """MKL's defaults: two steps of iterative refinement."""

    parameters = {}


class PyAmg(Solver):
    """A PyAMG hierarchy with its defaults as preconditioner of CG, column by column."""

    accuracy = "iterative"
    most_iterations = 500
    build = None

    def __init__(self, threads, tolerance):
        super().__init__(threads, tolerance)
        self.pyamg, self.version = load("pyamg")
        self.threads = 1

    def details(self):
        return {"version": f"pyamg {self.version}", "hierarchy": f"{self.build}, defaults, accel=cg"}

    def prepare(self, matrix, order):
        options = {} if self.build == "ruge_stuben_solver" else {"symmetry": "symmetric"}
        self.hierarchy = getattr(self.pyamg, self.build)(matrix, **options)
        self.factor_nonzeros = int(sum(level.A.nnz for level in self.hierarchy.levels))

    def arrange(self, b):
        return np.asfortranarray(b)

    def solve(self, b):
        x = np.empty_like(b)
        self.iterations = 0
        for j in range(b.shape[1]):
            residuals = []
            x[:, j], info = self.hierarchy.solve(
                b[:, j], tol=self.tolerance, maxiter=self.most_iterations, accel="cg", residuals=residuals, return_info=True)
            if info != 0:
                raise Refusal("not_converged", f"column {j}: {len(residuals) - 1} iterations")
            self.iterations = max(self.iterations, len(residuals) - 1)
        return x


class PyAmgAggregation(PyAmg):
    build = "smoothed_aggregation_solver"


class PyAmgRootNode(PyAmg):
    build = "rootnode_solver"


class PyAmgRugeStuben(PyAmg):
    build = "ruge_stuben_solver"


class CholesPy(Solver):
    """cholespy on the CPU: CHOLMOD's supernodal analysis, its own sweeps."""

    class_name, dtype = "CholeskySolverD", np.float64

    def __init__(self, threads, tolerance):
        super().__init__(threads, tolerance)
        self.cholespy, self.version = load("cholespy")
        self.threads = 1

    def details(self):
        return {"version": f"cholespy {self.version}", "class": self.class_name}

    def prepare(self, matrix, order):
        make = getattr(self.cholespy, self.class_name)
        self.solver = make(matrix.shape[0], matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32),
                           matrix.data.astype(self.dtype), self.cholespy.MatrixType.CSR)

    def arrange(self, b):
        self.x = np.empty(b.shape, self.dtype)
        return np.ascontiguousarray(b, self.dtype)

    def solve(self, b):
        self.solver.solve(b, self.x)
        return self.x


class CholesPySingle(CholesPy):
    class_name, dtype, precision = "CholeskySolverF", np.float32, "f32"


SOLVERS = {
    "igl-mqwf": IglMinQuad,
    "igl-harmonic": IglHarmonic,
    "mkl-pardiso": Pardiso,
    "mkl-pardiso-refined": PardisoRefined,
    "pyamg-sa": PyAmgAggregation,
    "pyamg-rootnode": PyAmgRootNode,
    "pyamg-rs": PyAmgRugeStuben,
    "cholespy": CholesPy,
    "cholespy-f32": CholesPySingle,
}
