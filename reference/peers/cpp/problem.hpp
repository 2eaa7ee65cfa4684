// The problems of the peer protocol: A x = b, and harmonic fields reduced to that form.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "system.hpp"

// n x k numbers, row after row, little-endian.
struct ArrayFile {
    explicit ArrayFile(const nlohmann::json& object);

    // The numbers; throws Refusal where the file does not hold exactly rows x columns of them.
    std::vector<double> doubles() const;
    std::vector<int> indices() const;

    std::string path;
    size_t rows, columns;
};

class Problem {
  public:
    explicit Problem(const nlohmann::json& object);

    // What the solver factorises; of order 0 when every vertex is constrained.
    const System& system() const { return system_; }
    bool harmonic() const { return harmonic_; }
    // Rows of a right-hand side (harmonic: of constraint values), and of a solution.
    size_t inputs() const { return harmonic_ ? fixed_.size() : system_.n; }
    size_t outputs() const { return vertices_; }

    // Takes values in the order of the entries of the matrix that was given.
    void set_values(const std::vector<double>& all);
    // The solver's columns for rows of input: the rows themselves, or -L_FC g.
    void to_columns(const double* input, int k, double* columns) const;
    // Rows of output from the solver's columns: constrained rows get their values, vertices without triangles 0.
    void to_rows(const double* input, const double* columns, int k, double* output) const;

  private:
    // An entry of L between a free row and a constraint; `source` is its place in L.
    struct Coupling {
        int row, constraint, source;
        double value;
    };

    void reduce(const System& laplacian);

    bool harmonic_ = false;
    size_t vertices_ = 0;
    System system_;
    std::vector<int> source_;  // of every entry of system_, its place in the matrix that was given
    std::vector<int> free_, fixed_;
    std::vector<Coupling> coupling_;
};
