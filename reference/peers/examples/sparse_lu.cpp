// A complete peer in C++: Eigen's SparseLU. Needs Eigen and nlohmann-json. Try it:
//
//   g++ -O3 -march=native -I/usr/include/eigen3 reference/peers/examples/sparse_lu.cpp -o sparse_lu
//   lapbench run --mesh sphere:5 --workload poisson --peer sparse-lu=./sparse_lu
#include <Eigen/Sparse>
#include <chrono>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
using nlohmann::json;
using Matrix = Eigen::SparseMatrix<double>;
using Block = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

template <class Number>
std::vector<Number> read(const json& file) {
    std::vector<Number> numbers(file.at("rows").get<size_t>() * file.at("columns").get<size_t>());
    std::ifstream stream(file.at("path").get<std::string>(), std::ios::binary);
    if (!stream.read(reinterpret_cast<char*>(numbers.data()), numbers.size() * sizeof(Number))) throw std::runtime_error("short file");
    return numbers;
}

Matrix both_triangles(const json& files) {
    const int n = files.at("n");
    const auto starts = read<uint32_t>(files.at("row_starts")), columns = read<uint32_t>(files.at("columns"));
    const auto values = read<double>(files.at("values"));
    std::vector<Eigen::Triplet<double>> entries;
    for (int i = 0; i < n; ++i)
        for (uint32_t at = starts[i]; at < starts[i + 1]; ++at) {
            entries.emplace_back(i, columns[at], values[at]);
            if (int(columns[at]) != i) entries.emplace_back(columns[at], i, values[at]);
        }
    Matrix matrix(n, n);
    matrix.setFromTriplets(entries.begin(), entries.end());
    return matrix;
}

template <class Work>
long long time(Work work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now() - start).count();
}

Eigen::SparseLU<Matrix> lu;

json answer(const json& request) {
    const std::string what = request.at("do");
    if (what == "describe")
        return {{"ok", {{"protocol", 1}, {"precision", "f64"}, {"accuracy", "direct"}, {"device", "cpu"}, {"device_type", "cpu"}, {"threads", 1}}}};
    if (what == "prepare" && request.at("problem").at("kind") == "system") {
        const Matrix matrix = both_triangles(request.at("problem").at("matrix"));
        const auto order = time([&] { lu.analyzePattern(matrix); });
        return {{"ok", {{"order_ns", order}, {"numeric_ns", time([&] { lu.factorize(matrix); })}}}};
    }
    if (what == "solve") {
        const auto given = read<double>(request.at("rhs"));
        const Eigen::Index k = request.at("rhs").at("columns"), n = request.at("rhs").at("rows");
        const Eigen::MatrixXd b = Eigen::Map<const Block>(given.data(), n, k);
        Eigen::MatrixXd x;
        std::vector<long long> samples;
        for (int i = -request.at("warmup").get<int>(); i < request.at("times").get<int>(); ++i) {
            const auto sample = time([&] { x = lu.solve(b); });
            if (i >= 0) samples.push_back(sample);
        }
        const Block rows = x;  // the protocol's layout: row after row
        std::ofstream(request.at("solution").get<std::string>(), std::ios::binary).write(reinterpret_cast<const char*>(rows.data()), rows.size() * sizeof(double));
        return {{"ok", {{"samples_ns", samples}}}};
    }
    if (what == "memory" || what == "quit") return {{"ok", json::object()}};
    return {{"error", {{"kind", "unsupported"}, {"message", what}}}};
}

int main() {
    for (std::string line; std::getline(std::cin, line);) {
        const json request = json::parse(line);
        json reply = answer(request);
        reply["id"] = request.at("id");
        std::cout << reply.dump() << std::endl;
        if (request.at("do") == "quit") break;
    }
}
