// A sparse symmetric positive definite matrix, its right-hand sides, and their files.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

// Upper triangle by rows, columns ascending, the diagonal entry first: read as columns it is the lower triangle.
struct System {
    int n = 0;
    std::vector<int> starts;   // n + 1
    std::vector<int> indices;  // starts[n]
    std::vector<double> values;
};

// Reads MatrixMarket (`.mtx`: coordinate, real, symmetric or general) or the binary form:
// u64 n, u64 entries, u32 starts[n + 1], u32 indices[entries], f64 values[entries], little-endian.
// Throws std::runtime_error that names the file.
System read_system(const std::string& path);

// Throws std::runtime_error, starting with `name`, where rows or columns are not in the order above.
void check_system(const System& a, const std::string& name);

// n x k numbers, vertex-major f64 without a header; `path` "-" stands for A x with x_ij = sin(i + 3 j + 1).
std::vector<double> read_right_hand_side(const std::string& path, const System& a, int k);

// Largest over the columns of |b - A x| / (|A| |x| + |b|) in the infinity norm, residual in extended precision.
// b and x are column-major.
double backward_error(const System& a, const std::vector<double>& b, const std::vector<double>& x, int k);
