// What every C++ peer does: analyse the pattern, factorise the values, solve.
#pragma once

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "system.hpp"

// What a solver cannot do; `kind` is a word of the peer protocol: out_of_memory, not_converged, not_positive_definite, unsupported, failed.
struct Refusal : std::runtime_error {
    Refusal(std::string kind, const std::string& message) : std::runtime_error(message), kind(std::move(kind)) {}
    std::string kind;
};

class Solver {
  public:
    virtual ~Solver() = default;
    // Library and version.
    virtual std::string version() const = 0;
    // Ordering and symbolic factorisation; keeps a copy of the matrix in the library's own form.
    virtual void analyse(const System& a) = 0;
    // Numeric factorisation of the values last given.
    virtual void factorise() = 0;
    // k columns, column-major as the library wants them; x is overwritten.
    virtual void solve(const double* b, double* x, int k) = 0;
    // Entries of the factor (of the preconditioner) with its diagonal, known after factorise().
    virtual double factor_entries() const = 0;
    // Bytes of the factor as stored, known after factorise().
    virtual double factor_bytes() const = 0;
    // Whether a solve reads the factor twice, once forward and once backward, for all columns together.
    virtual bool reads_factor_once_per_sweep() const { return false; }
    // Iterations of the last solve, the most over its columns; -1 for a direct solver.
    virtual int iterations() const { return -1; }
    // New values on the pattern of analyse().
    virtual void set_values(const System& a) = 0;
};

// Ids as in the results: cholmod-simplicial-metis, eigen-llt ...
std::vector<std::string> solver_ids();

// Throws Refusal for an unknown id. `tolerance` concerns iterative solvers only.
std::unique_ptr<Solver> open_solver(const std::string& id, int threads, double tolerance);

std::unique_ptr<Solver> open_cholmod(bool supernodal, bool metis, int threads);
std::unique_ptr<Solver> open_eigen(const std::string& kind, int threads, double tolerance);
