"""A complete peer in Python: SuperLU through scipy. Try it:

    lapbench run --mesh sphere:5 --workload harmonic,poisson --peer superlu='python3 reference/peers/examples/superlu.py'
"""

import json
import sys
import time

import numpy as np
import scipy
import scipy.sparse as sparse
from scipy.sparse.linalg import splu


def read(file, dtype="<f8"):
    return np.fromfile(file["path"], dtype).reshape(file["rows"], file["columns"])


def matrix(files):
    rows = (read(files["values"]).ravel(), read(files["columns"], "<u4").ravel(), read(files["row_starts"], "<u4").ravel())
    upper = sparse.csr_matrix(rows, (files["n"], files["n"]))
    return (upper + sparse.triu(upper, 1).T).tocsc()


class Peer:
    def describe(self, request):
        return {"protocol": 1, "precision": "f64", "accuracy": "direct", "device": "cpu", "device_type": "cpu",
                "threads": 1, "details": {"version": f"scipy {scipy.__version__}"}}

    def prepare(self, request):
        problem = request["problem"]
        if problem["kind"] not in ("system", "harmonic"):
            raise NotImplementedError(f"problems of kind {problem['kind']}")
        self.fixed = None if problem["kind"] == "system" else read(problem["fixed"], "<u4").ravel()
        whole = matrix(problem["matrix" if self.fixed is None else "laplacian"])
        unknown = whole.diagonal() != 0  # vertices without a triangle have empty rows; their field is 0
        unknown[[] if self.fixed is None else self.fixed] = False
        self.rows, self.n = np.flatnonzero(unknown), whole.shape[0]
        self.coupling = None if self.fixed is None else -whole[self.rows][:, self.fixed]
        start = time.perf_counter_ns()
        self.lu = splu(whole[self.rows][:, self.rows], permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        return {"numeric_ns": time.perf_counter_ns() - start}

    def solve(self, request):
        given, samples = read(request["rhs"]), []
        solution = np.zeros((self.n, given.shape[1]))
        for repetition in range(request["warmup"] + request["times"]):
            start = time.perf_counter_ns()
            solution[self.rows] = self.lu.solve(given if self.fixed is None else self.coupling @ given)
            if self.fixed is not None:
                solution[self.fixed] = given
            if repetition >= request["warmup"]:
                samples.append(time.perf_counter_ns() - start)
        solution.tofile(request["solution"])
        return {"samples_ns": samples}

    def memory(self, request):
        return {"factor_nonzeros": int(self.lu.L.nnz)}


peer = Peer()
for line in sys.stdin:
    request = json.loads(line)
    try:
        if request["do"] == "quit":
            answer = {"ok": {}}
        elif request["do"] in ("describe", "prepare", "solve", "memory"):
            answer = {"ok": getattr(peer, request["do"])(request)}
        else:
            raise NotImplementedError(request["do"])
    except NotImplementedError as what:
        answer = {"error": {"kind": "unsupported", "message": str(what)}}
    print(json.dumps({"id": request["id"], **answer}), flush=True)
    if request["do"] == "quit":
        break
