// chol_runner SYSTEM RHS K THREADS REPEATS [SOLVER ...]: times each solver on one system, one JSON line each.
// Times are inside the program, by the monotonic clock, in nanoseconds; reading files and arranging the right-hand
// side in columns are not timed. Each solver is checked: backward_error.

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include "solver.hpp"

namespace {

template <class Work>
long long nanoseconds(Work&& work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now() - start).count();
}

void measure(const std::string& id, const System& a, const std::vector<double>& b, int k, int threads, int repeats) {
    const double tolerance = 1e-10;
    auto solver = open_solver(id, threads, tolerance);
    std::vector<double> x(b.size(), 0.0);
    const long long order = nanoseconds([&] { solver->analyse(a); });
    const long long numeric = nanoseconds([&] { solver->factorise(); });
    const long long again = nanoseconds([&] { solver->factorise(); });
    const long long first = nanoseconds([&] { solver->solve(b.data(), x.data(), k); });
    std::vector<long long> samples;
    for (int r = 0; r < repeats; ++r) samples.push_back(nanoseconds([&] { solver->solve(b.data(), x.data(), k); }));
    std::printf("{\"solver\":\"%s\",\"version\":\"%s\",\"threads\":%d,\"n\":%d,\"columns\":%d,\"order_ns\":%lld,\"numeric_ns\":%lld,"
                "\"numeric_again_ns\":%lld,\"first_solve_ns\":%lld,\"nnz_l\":%.0f,\"iterations\":%d,\"backward_error\":%.3e,\"solve_ns\":[",
                id.c_str(), solver->version().c_str(), threads, a.n, k, order, numeric, again, first,
                solver->factor_entries(), solver->iterations(), backward_error(a, b, x, k));
    for (size_t r = 0; r < samples.size(); ++r) std::printf("%s%lld", r ? "," : "", samples[r]);
    std::printf("]}\n");
    std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 6) {
        std::fprintf(stderr, "usage: %s SYSTEM RHS K THREADS REPEATS [SOLVER ...]\nsolvers:", argv[0]);
        for (const auto& id : solver_ids()) std::fprintf(stderr, " %s", id.c_str());
        std::fprintf(stderr, "\nRHS: n x k doubles, or - for A x with x_ij = sin(i + 3 j + 1)\n");
        return 2;
    }
    const int k = std::atoi(argv[3]), threads = std::atoi(argv[4]), repeats = std::atoi(argv[5]);
    if (k < 1 || threads < 1 || repeats < 1) {
        std::fprintf(stderr, "K, THREADS and REPEATS are at least 1\n");
        return 2;
    }
    try {
        const System a = read_system(argv[1]);
        const auto b = read_right_hand_side(argv[2], a, k);
        const std::vector<std::string> ids = argc > 6 ? std::vector<std::string>(argv + 6, argv + argc) : solver_ids();
        for (const auto& id : ids) measure(id, a, b, k, threads, repeats);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}
