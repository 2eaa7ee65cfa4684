// What every C++ peer does: analyse the pattern, factorise the values, solve.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "system.hpp"

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
    // Entries of the factor with its diagonal, 0 where there is none.
    virtual double factor_entries() const = 0;
    // Iterations of the last solve, all columns together; -1 for a direct solver.
    virtual int iterations() const { return -1; }
    // New values on the pattern of analyse().
    virtual void set_values(const System& a) = 0;
};

// Ids as in the results: cholmod-simplicial-metis, eigen-llt ...
std::vector<std::string> solver_ids();

// Throws std::runtime_error for an unknown id. `tolerance` concerns iterative solvers only.
std::unique_ptr<Solver> open_solver(const std::string& id, int threads, double tolerance);

std::unique_ptr<Solver> open_cholmod(bool supernodal, bool metis, int threads);
std::unique_ptr<Solver> open_eigen(const std::string& kind, int threads, double tolerance);
