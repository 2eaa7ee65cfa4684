"""The problems of the peer protocol: A x = b, and harmonic fields reduced to that form."""

import numpy as np
import scipy.sparse as sparse


class Refusal(Exception):
    """What a solver cannot do; `kind` is a word of the protocol: unavailable, unsupported, not_converged, ..."""

    def __init__(self, kind, message):
        super().__init__(message)
        self.kind = kind


def read(file, dtype):
    """The numbers of an array file, rows x columns."""
    numbers = np.fromfile(file["path"], dtype)
    if numbers.size != file["rows"] * file["columns"]:
        raise Refusal("failed", f"{file['path']} does not hold {file['rows']} x {file['columns']} numbers")
    return numbers.reshape(file["rows"], file["columns"])


class Pattern:
    """A symmetric matrix given by its upper triangle, and how its entries lie in the whole matrix."""

    def __init__(self, files):
        n = files["n"]
        starts, columns = (read(files[name], "<u4").ravel().astype(np.int32) for name in ("row_starts", "columns"))
        rows = np.repeat(np.arange(n, dtype=np.int32), np.diff(starts))
        off = rows != columns
        entries = np.arange(len(columns))
        order = np.concatenate([entries, entries[off]])
        shape = (n, n)
        where = (np.concatenate([rows, columns[off]]), np.concatenate([columns, rows[off]]))
        # Entry numbers (from 1: a stored zero would vanish) travel through the conversion in place of the values.
        numbered = sparse.coo_matrix((order + 1.0, where), shape).tocsr()
        numbered.sort_indices()
        self.source = numbered.data.astype(np.int64) - 1
        self.indptr, self.indices, self.shape = numbered.indptr, numbered.indices, shape

    def matrix(self, values):
        """Both triangles, by rows (or columns: it is symmetric), indices sorted."""
        return sparse.csr_matrix((values.ravel()[self.source], self.indices, self.indptr), self.shape)


class Problem:
    """`matrix` is what the solver factorises; right-hand sides and solutions have k columns, row after row."""

    def __init__(self, description):
        self.kind = description["kind"]
        if self.kind not in ("system", "harmonic"):
            raise Refusal("unsupported", f"problems of kind {self.kind}")
        files = description["matrix" if self.kind == "system" else "laplacian"]
        self.pattern = Pattern(files)
        self.vertices = files["n"]
        if self.kind == "harmonic":
            self.fixed = read(description["fixed"], "<u4").ravel().astype(np.int64)
            mesh = [description.get("positions"), description.get("triangles")]
            self.mesh = None if None in mesh else (read(mesh[0], "<f8"), read(mesh[1], "<u4").astype(np.int64))
        self.set_values(read(files["values"], "<f8"))

    def set_values(self, values):
        whole = self.pattern.matrix(values)
        if self.kind == "system":
            self.matrix = whole
            return
        in_a_triangle = whole.diagonal() != 0
        in_a_triangle[self.fixed] = False
        self.laplacian = whole
        self.free = np.flatnonzero(in_a_triangle)
        rows = whole[self.free]
        self.matrix = rows[:, self.free].tocsr()
        self.matrix.sort_indices()
        self.coupling = -rows[:, self.fixed].tocsr()

    @property
    def inputs(self):
        return len(self.fixed) if self.kind == "harmonic" else self.vertices
