#include "system.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <sstream>
#include <stdexcept>

namespace {

[[noreturn]] void fail(const std::string& path, const std::string& why) {
    throw std::runtime_error(path + ": " + why);
}

template <class T>
std::vector<T> read_array(std::ifstream& file, const std::string& path, size_t count) {
    std::vector<T> array(count);
    file.read(reinterpret_cast<char*>(array.data()), static_cast<std::streamsize>(count * sizeof(T)));
    if (!file) fail(path, "ends early");
    return array;
}

System read_binary(const std::string& path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    if (!file) fail(path, "cannot be opened");
    const uint64_t bytes = static_cast<uint64_t>(file.tellg());
    file.seekg(0);
    const auto head = read_array<uint64_t>(file, path, 2);
    const uint64_t most = std::numeric_limits<int>::max();
    if (head[0] >= most || head[1] > most || bytes != 16 + 4 * (head[0] + 1) + 12 * head[1]) fail(path, "sizes do not fit the file");
    System a;
    a.n = static_cast<int>(head[0]);
    a.starts = read_array<int>(file, path, head[0] + 1);
    a.indices = read_array<int>(file, path, head[1]);
    a.values = read_array<double>(file, path, head[1]);
    return a;
}

struct Entry {
    int row, column;
    double value;
};

System from_entries(int n, std::vector<Entry> entries) {
    std::sort(entries.begin(), entries.end(),
              [](const Entry& p, const Entry& q) { return p.row != q.row ? p.row < q.row : p.column < q.column; });
    System a;
    a.n = n;
    a.starts.assign(n + 1, 0);
    for (const Entry& e : entries) {
        ++a.starts[e.row + 1];
        a.indices.push_back(e.column);
        a.values.push_back(e.value);
    }
    for (int i = 0; i < n; ++i) a.starts[i + 1] += a.starts[i];
    return a;
}

System read_matrix_market(const std::string& path) {
    std::ifstream file(path);
    if (!file) fail(path, "cannot be opened");
    std::string line;
    std::getline(file, line);
    if (line.rfind("%%MatrixMarket matrix coordinate real ", 0) != 0) fail(path, "is not a real coordinate MatrixMarket file");
    const bool symmetric = line.find("symmetric") != std::string::npos;
    while (std::getline(file, line) && line[0] == '%') {}
    long rows = 0, columns = 0, count = 0;
    std::istringstream(line) >> rows >> columns >> count;
    if (rows <= 0 || rows != columns || rows >= std::numeric_limits<int>::max()) fail(path, "is not square");
    std::vector<Entry> entries;
    for (long e = 0; e < count; ++e) {
        long i, j;
        double value;
        if (!(file >> i >> j >> value) || i < 1 || j < 1 || i > rows || j > rows) fail(path, "entry " + std::to_string(e + 1) + " is wrong");
        if (symmetric || i <= j)
            entries.push_back({static_cast<int>(std::min(i, j) - 1), static_cast<int>(std::max(i, j) - 1), value});
    }
    return from_entries(static_cast<int>(rows), std::move(entries));
}

// y += A x for one column, with both triangles.
template <class Real>
void multiply_add(const System& a, const double* x, Real* y) {
    for (int i = 0; i < a.n; ++i) {
        y[i] += Real(a.values[a.starts[i]]) * x[i];
        for (int e = a.starts[i] + 1; e < a.starts[i + 1]; ++e) {
            const int j = a.indices[e];
            y[i] += Real(a.values[e]) * x[j];
            y[j] += Real(a.values[e]) * x[i];
        }
    }
}

double largest(const double* x, int n) {
    double most = 0;
    for (int i = 0; i < n; ++i) most = std::max(most, std::abs(x[i]));
    return most;
}

double row_sum_norm(const System& a) {
    std::vector<double> sums(a.n, 0.0);
    for (int i = 0; i < a.n; ++i)
        for (int e = a.starts[i]; e < a.starts[i + 1]; ++e) {
            sums[i] += std::abs(a.values[e]);
            if (a.indices[e] != i) sums[a.indices[e]] += std::abs(a.values[e]);
        }
    return largest(sums.data(), a.n);
}

}  // namespace

void check_system(const System& a, const std::string& name) {
    if (a.n < 0 || a.starts.size() != static_cast<size_t>(a.n) + 1 || a.starts.front() != 0 ||
        !std::is_sorted(a.starts.begin(), a.starts.end()) || static_cast<size_t>(a.starts.back()) != a.indices.size() ||
        a.indices.size() != a.values.size())
        fail(name, "row starts do not fit the number of entries");
    for (int i = 0; i < a.n; ++i) {
        if (a.starts[i] == a.starts[i + 1] || a.indices[a.starts[i]] != i) fail(name, "row without its diagonal first");
        for (int e = a.starts[i] + 1; e < a.starts[i + 1]; ++e)
            if (a.indices[e] <= a.indices[e - 1] || a.indices[e] >= a.n) fail(name, "columns not ascending or out of range");
    }
}

System read_system(const std::string& path) {
    const bool text = path.size() > 4 && path.substr(path.size() - 4) == ".mtx";
    System a = text ? read_matrix_market(path) : read_binary(path);
    check_system(a, path);
    return a;
}

std::vector<double> read_right_hand_side(const std::string& path, const System& a, int k) {
    const size_t n = static_cast<size_t>(a.n);
    std::vector<double> columns(n * k, 0.0);
    if (path == "-") {
        std::vector<double> x(n);
        for (int j = 0; j < k; ++j) {
            for (size_t i = 0; i < n; ++i) x[i] = std::sin(static_cast<double>(i + 3 * j + 1));
            multiply_add(a, x.data(), &columns[n * j]);
        }
        return columns;
    }
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    if (!file || static_cast<size_t>(file.tellg()) != columns.size() * sizeof(double)) fail(path, "does not hold n x k numbers");
    file.seekg(0);
    const auto rows = read_array<double>(file, path, columns.size());
    for (size_t i = 0; i < n; ++i)
        for (int j = 0; j < k; ++j) columns[n * j + i] = rows[i * k + j];
    return columns;
}

double backward_error(const System& a, const std::vector<double>& b, const std::vector<double>& x, int k) {
    const double norm = row_sum_norm(a);
    double worst = 0;
    for (int j = 0; j < k; ++j) {
        const double* bj = &b[static_cast<size_t>(a.n) * j];
        const double* xj = &x[static_cast<size_t>(a.n) * j];
        std::vector<long double> residual(a.n, 0.0L);
        multiply_add(a, xj, residual.data());
        double most = 0;
        for (int i = 0; i < a.n; ++i) {
            const double r = static_cast<double>(std::abs(bj[i] - residual[i]));
            if (!(r <= most)) most = r;  // keeps a NaN, which std::max would drop
        }
        const double scale = norm * largest(xj, a.n) + largest(bj, a.n);
        const double eta = scale > 0 ? most / scale : most;
        if (!(eta <= worst)) worst = eta;
    }
    return worst;
}
