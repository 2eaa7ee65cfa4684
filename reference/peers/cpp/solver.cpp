#include "solver.hpp"

std::vector<std::string> solver_ids() {
    return {"cholmod-simplicial-metis", "cholmod-simplicial-amd", "cholmod-supernodal-metis", "cholmod-supernodal-amd",
            "eigen-llt",                "eigen-ldlt",             "eigen-cg-ic"};
}

std::unique_ptr<Solver> open_solver(const std::string& id, int threads, double tolerance) {
    const auto is = [&](const char* name) { return id == name; };
    if (is("cholmod-simplicial-metis")) return open_cholmod(false, true, threads);
    if (is("cholmod-simplicial-amd")) return open_cholmod(false, false, threads);
    if (is("cholmod-supernodal-metis")) return open_cholmod(true, true, threads);
    if (is("cholmod-supernodal-amd")) return open_cholmod(true, false, threads);
    if (is("eigen-llt") || is("eigen-ldlt") || is("eigen-cg-ic")) return open_eigen(id.substr(6), threads, tolerance);
    throw Refusal("unavailable", "no such solver: " + id);
}
