#include "problem.hpp"

#include <algorithm>
#include <fstream>

#include "solver.hpp"

namespace {

template <class T>
std::vector<T> read(const ArrayFile& file) {
    std::vector<T> numbers(file.rows * file.columns);
    std::ifstream stream(file.path, std::ios::binary | std::ios::ate);
    if (!stream || static_cast<size_t>(stream.tellg()) != numbers.size() * sizeof(T))
        throw Refusal("failed", file.path + " does not hold " + std::to_string(numbers.size()) + " numbers");
    stream.seekg(0);
    stream.read(reinterpret_cast<char*>(numbers.data()), static_cast<std::streamsize>(numbers.size() * sizeof(T)));
    return numbers;
}

System read_matrix(const nlohmann::json& object) {
    System a;
    a.n = object.at("n").get<int>();
    a.starts = ArrayFile(object.at("row_starts")).indices();
    a.indices = ArrayFile(object.at("columns")).indices();
    a.values = ArrayFile(object.at("values")).doubles();
    check_system(a, "matrix");
    return a;
}

}  // namespace

ArrayFile::ArrayFile(const nlohmann::json& object)
    : path(object.at("path")), rows(object.at("rows")), columns(object.at("columns")) {}

std::vector<double> ArrayFile::doubles() const { return read<double>(*this); }
std::vector<int> ArrayFile::indices() const { return read<int>(*this); }

Problem::Problem(const nlohmann::json& object) {
    const std::string kind = object.at("kind");
    if (kind == "system") {
        system_ = read_matrix(object.at("matrix"));
        vertices_ = system_.n;
    } else if (kind == "harmonic") {
        harmonic_ = true;
        fixed_ = ArrayFile(object.at("fixed")).indices();
        reduce(read_matrix(object.at("laplacian")));
    } else {
        throw Refusal("unsupported", "problems of kind " + kind);
    }
}

void Problem::reduce(const System& l) {
    const int constrained = -1, absent = -2;
    vertices_ = l.n;
    std::vector<int> number(l.n, absent), constraint(l.n, -1);
    for (size_t c = 0; c < fixed_.size(); ++c) {
        if (fixed_[c] < 0 || fixed_[c] >= l.n) throw Refusal("failed", "a constrained vertex does not exist");
        number[fixed_[c]] = constrained;
        constraint[fixed_[c]] = static_cast<int>(c);
    }
    for (int i = 0; i < l.n; ++i) {
        const bool in_a_triangle = l.values[l.starts[i]] != 0;
        if (number[i] == absent && in_a_triangle) {
            number[i] = static_cast<int>(free_.size());
            free_.push_back(i);
        }
    }
    system_.starts.push_back(0);
    for (int i = 0; i < l.n; ++i) {
        for (int e = l.starts[i]; e < l.starts[i + 1]; ++e) {
            const int j = l.indices[e];
            if (number[i] >= 0 && number[j] >= 0) {
                system_.indices.push_back(number[j]);
                system_.values.push_back(l.values[e]);
                source_.push_back(e);
            } else if (number[i] >= 0 && constraint[j] >= 0) {
                coupling_.push_back({number[i], constraint[j], e, l.values[e]});
            } else if (constraint[i] >= 0 && number[j] >= 0) {
                coupling_.push_back({number[j], constraint[i], e, l.values[e]});
            }
        }
        if (number[i] >= 0) system_.starts.push_back(static_cast<int>(system_.indices.size()));
    }
    system_.n = static_cast<int>(free_.size());
}

void Problem::set_values(const std::vector<double>& all) {
    if (!harmonic_) {
        if (all.size() != system_.values.size()) throw Refusal("failed", "as many values as the matrix has entries expected");
        system_.values = all;
        return;
    }
    for (size_t e = 0; e < source_.size(); ++e) system_.values[e] = all.at(source_[e]);
    for (Coupling& c : coupling_) c.value = all.at(c.source);
}

void Problem::to_columns(const double* input, int k, double* columns) const {
    const size_t n = system_.n;
    if (!harmonic_) {
        for (size_t i = 0; i < n; ++i)
            for (int j = 0; j < k; ++j) columns[n * j + i] = input[i * k + j];
        return;
    }
    std::fill(columns, columns + n * k, 0.0);
    for (const Coupling& c : coupling_)
        for (int j = 0; j < k; ++j) columns[n * j + c.row] -= c.value * input[static_cast<size_t>(c.constraint) * k + j];
}

void Problem::to_rows(const double* input, const double* columns, int k, double* output) const {
    const size_t n = system_.n;
    if (!harmonic_) {
        for (size_t i = 0; i < n; ++i)
            for (int j = 0; j < k; ++j) output[i * k + j] = columns[n * j + i];
        return;
    }
    for (size_t i = 0; i < n; ++i)
        for (int j = 0; j < k; ++j) output[static_cast<size_t>(free_[i]) * k + j] = columns[n * j + i];
    for (size_t c = 0; c < fixed_.size(); ++c)
        for (int j = 0; j < k; ++j) output[static_cast<size_t>(fixed_[c]) * k + j] = input[c * k + j];
}
