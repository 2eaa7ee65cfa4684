"""peer.py ID: serves one solver over the peer protocol, a JSON object per line on stdin, one per line on stdout.

Times are taken here, by the monotonic clock: of `system` problems only the solve, the right-hand side being arranged as
the library wants it before; of `harmonic` problems all of -L_FC g, solve, and spreading the field over the vertices; of pipelines the library's calls.
"""

import json
import os
import pathlib
import platform
import sys
import time

import numpy as np

from meshes import MESH_SOLVERS, MeshProblem
from problem import Problem, Refusal, read
from solvers import SOLVERS as MATRIX_SOLVERS

SOLVERS = {**MATRIX_SOLVERS, **MESH_SOLVERS}


class Server:
    def __init__(self, solver_id):
        self.solver_id, self.problem = solver_id, None

    def answer(self, request):
        do = request["do"]
        if do not in ("describe", "prepare", "solve", "update", "open_loop", "memory", "quit"):
            raise Refusal("unsupported", f"requests of kind {do}")
        if do in ("solve", "update", "open_loop") and self.problem is None:
            raise Refusal("failed", "nothing is prepared")
        return getattr(self, do)(request)

    def describe(self, request):
        if self.solver_id not in SOLVERS:
            raise Refusal("unavailable", f"no solver {self.solver_id}; there are {', '.join(SOLVERS)}")
        self.solver = SOLVERS[self.solver_id](request["threads"], request["tolerance"])
        details = {"python": platform.python_version(), "numpy": np.__version__, **self.solver.details()}
        return {"protocol": 1, "precision": self.solver.precision, "accuracy": self.solver.accuracy, "device": "cpu",
                "device_type": "cpu", "threads": self.solver.threads, "details": details}

    def prepare(self, request):
        self.max_columns = request["max_columns"]
        kind = request["problem"]["kind"]
        if self.solver.kind != {"harmonic": "system"}.get(kind, kind):
            raise Refusal("unsupported", f"problems of kind {kind}")
        if self.solver.kind != "system":
            return self.prepare_mesh(request["problem"])
        self.problem = problem = Problem(request["problem"])
        marks = [time.perf_counter_ns()]
        if hasattr(self.solver, "take_mesh"):
            return {"assemble_ns": self.solver.take_mesh(problem, self.is_whole())}
        if problem.matrix.shape[0] > 0:
            self.factorise(lambda: marks.append(time.perf_counter_ns()))
        marks.append(time.perf_counter_ns())
        if len(marks) == 3:
            return {"order_ns": marks[1] - marks[0], "numeric_ns": marks[2] - marks[1]}
        return {"numeric_ns": marks[1] - marks[0]}  # a library that does all in one call

    def prepare_mesh(self, description):
        self.problem = MeshProblem(description)
        start = time.perf_counter_ns()
        self.solver.prepare_mesh(self.problem)
        return {"numeric_ns": time.perf_counter_ns() - start}

    def factorise(self, order):
        if self.knows_harmonic():
            self.solver.prepare_known(self.problem.laplacian, self.problem.fixed)
        else:
            self.solver.prepare(self.problem.matrix, order)

    def knows_harmonic(self):
        """Whether the library takes the whole Laplacian: not with absent vertices, whose rows are empty."""
        return self.is_whole() and hasattr(self.solver, "prepare_known")

    def is_whole(self):
        problem = self.problem
        return problem.kind == "harmonic" and len(problem.free) + len(problem.fixed) == problem.vertices

    def block(self, file):
        b = read(file, "<f8")
        if b.shape[0] != self.problem.inputs or not 1 <= b.shape[1] <= self.max_columns:
            raise Refusal("failed", f"{b.shape[0]} x {b.shape[1]} numbers were not prepared for")
        return b

    def stepper(self, b):
        """A function that solves once and returns the solution."""
        problem, solver = self.problem, self.solver
        if solver.kind != "system":
            return lambda: solver.solve(b)
        if problem.kind == "system":
            arranged = solver.arrange(b)
            return lambda: solver.solve(arranged)
        if self.knows_harmonic() or hasattr(solver, "take_mesh"):
            return lambda: solver.solve_known(b)
        field = np.zeros((problem.vertices, b.shape[1]))

        def step():
            if len(problem.free):
                field[problem.free] = solver.solve(solver.arrange(problem.coupling @ b))
            field[problem.fixed] = b
            return field

        return step

    def timed(self, samples):
        return {"samples_ns": samples, "iterations": self.solver.iterations}

    def solve(self, request):
        step, samples = self.stepper(self.block(request["rhs"])), []
        for repetition in range(request["warmup"] + request["times"]):
            start = time.perf_counter_ns()
            x = step()
            if repetition >= request["warmup"]:
                samples.append(time.perf_counter_ns() - start)
        np.ascontiguousarray(x, "<f8").tofile(request["solution"])
        return self.timed(samples)

    def update(self, request):
        if hasattr(self.solver, "take_mesh"):
            raise Refusal("unsupported", "this call assembles by itself and takes no values")
        values, samples = read(request["values"], "<f8"), []
        for _ in range(request["times"]):
            self.problem.set_values(values)  # in scipy, on the way to every one of these libraries: not theirs to answer for
            start = time.perf_counter_ns()
            if self.knows_harmonic():
                self.factorise(lambda: None)
            elif self.problem.matrix.shape[0] > 0:
                self.solver.update(self.problem.matrix)
            samples.append(time.perf_counter_ns() - start)
        return self.timed(samples)

    def open_loop(self, request):
        """Latencies from the scheduled starts: a late frame makes the next ones late too."""
        step, samples, period = self.stepper(self.block(request["input"])), [], 1e9 / request["hz"]
        begin = time.perf_counter_ns()
        for frame in range(request["frames"]):
            scheduled = begin + int(frame * period)
            if time.perf_counter_ns() - begin >= request["limit_ns"]:
                break
            left = scheduled - time.perf_counter_ns()
            if left > 300_000:  # sleeping ends late: spin the rest
                time.sleep((left - 300_000) / 1e9)
            while time.perf_counter_ns() < scheduled:
                pass
            step()
            samples.append(time.perf_counter_ns() - scheduled)
        return self.timed(samples)

    def memory(self, request):
        nonzeros = self.solver.factor_nonzeros if self.problem else None
        return {"peak_rss_bytes": peak_resident_bytes(), "factor_nonzeros": nonzeros}

    def quit(self, request):
        return {}


def peak_resident_bytes():
    """VmHWM of this process, not getrusage's maximum, which a child inherits from its parent; None where not known."""
    try:
        lines = pathlib.Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("VmHWM:")), None)


def outcome(server, request):
    try:
        return {"ok": server.answer(request)}
    except Refusal as why:
        return {"error": {"kind": why.kind, "message": str(why)}}
    except MemoryError:
        return {"error": {"kind": "out_of_memory", "message": "out of memory"}}
    except Exception as error:  # whatever a library throws is an answer, not the end of the process
        return {"error": {"kind": "failed", "message": f"{type(error).__name__}: {error}"}}


def main():
    if len(sys.argv) != 2:
        sys.exit(f"usage: peer.py ID; solvers: {' '.join(SOLVERS)}")
    # Libraries print to stdout too; their words go to stderr, the answers where stdout was.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    server = Server(sys.argv[1])
    for line in sys.stdin:
        try:
            request = json.loads(line)
            number = request["id"]
        except (ValueError, TypeError, KeyError) as error:
            request, number = None, 0
            answer = {"error": {"kind": "failed", "message": f"not a request: {error}"}}
        if request is not None:
            answer = outcome(server, request)
        print(json.dumps({"id": number, **answer}), file=answers, flush=True)
        if request is not None and request.get("do") == "quit":
            break


if __name__ == "__main__":
    main()
