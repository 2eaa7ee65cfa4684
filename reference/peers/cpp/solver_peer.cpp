// solver_peer ID: serves one solver over the peer protocol, a JSON object per line on stdin, one per line on stdout.
// Times are taken here, by the monotonic clock: of `system` problems only the solve, the right-hand side being arranged
// in columns before; of `harmonic` problems all of -L_FC g, solve, and spreading the field over the vertices.

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <memory>
#include <new>
#include <thread>

#include "problem.hpp"
#include "solver.hpp"

namespace {

using nlohmann::json;
using Clock = std::chrono::steady_clock;

long long nanoseconds_since(Clock::time_point start) {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now() - start).count();
}

// VmHWM of this process; null where the system does not say.
json peak_resident_bytes() {
    std::ifstream status("/proc/self/status");
    for (std::string word; status >> word;)
        if (word == "VmHWM:") {
            long long kilobytes;
            status >> kilobytes;
            return kilobytes * 1024;
        }
    return nullptr;
}

class Server {
  public:
    explicit Server(std::string id) : id_(std::move(id)) {}

    json answer(const json& request) {
        const std::string what = request.at("do");
        if (what == "describe") return describe(request);
        if (what == "prepare") return prepare(request);
        if (what == "solve") return solve(request);
        if (what == "update") return update(request);
        if (what == "open_loop") return open_loop(request);
        if (what == "memory") return memory();
        if (what == "quit") return json::object();
        throw Refusal("unsupported", "requests of kind " + what);
    }

  private:
    json describe(const json& request) {
        threads_ = request.at("threads");
        tolerance_ = request.at("tolerance");
        const std::string version = open_solver(id_, threads_, tolerance_)->version();
        const bool iterative = id_ == "eigen-cg-ic";
        return {{"protocol", 1},
                {"precision", "f64"},
                {"accuracy", iterative ? "iterative" : "direct"},
                {"device", "cpu"},
                {"device_type", "cpu"},
                {"threads", threads_},
                {"details", {{"version", version}, {"compiler", "g++ " __VERSION__}, {"flags", PEER_FLAGS}}}};
    }

    json prepare(const json& request) {
        solver_.reset();
        problem_ = std::make_unique<Problem>(request.at("problem"));
        max_columns_ = request.at("max_columns");
        if (problem_->system().n == 0) return json::object();
        solver_ = open_solver(id_, threads_, tolerance_);
        auto start = Clock::now();
        solver_->analyse(problem_->system());
        const long long order = nanoseconds_since(start);
        start = Clock::now();
        solver_->factorise();
        return {{"order_ns", order}, {"numeric_ns", nanoseconds_since(start)}};  // ordering includes the symbolic part
    }

    // Input, columns and output of solves with k right-hand sides.
    struct Block {
        int k;
        std::vector<double> input, right, x, output;
    };

    Block block(const json& file) const {
        if (!problem_) throw Refusal("failed", "nothing is prepared");
        const ArrayFile array(file);
        if (array.rows != problem_->inputs() || array.columns < 1 || array.columns > max_columns_)
            throw Refusal("failed", "a right-hand side of another shape than was prepared for");
        Block b{static_cast<int>(array.columns), array.doubles(), {}, {}, {}};
        b.right.resize(problem_->system().n * array.columns);
        b.x.resize(b.right.size());
        b.output.resize(problem_->outputs() * array.columns, 0.0);
        problem_->to_columns(b.input.data(), b.k, b.right.data());
        return b;
    }

    long long solve_once(Block& b) {
        const auto start = Clock::now();
        if (problem_->harmonic()) problem_->to_columns(b.input.data(), b.k, b.right.data());
        if (solver_) solver_->solve(b.right.data(), b.x.data(), b.k);
        if (problem_->harmonic()) problem_->to_rows(b.input.data(), b.x.data(), b.k, b.output.data());
        return nanoseconds_since(start);
    }

    json timed(const std::vector<long long>& samples) const {
        const int iterations = solver_ ? solver_->iterations() : -1;
        return {{"samples_ns", samples}, {"iterations", iterations < 0 ? json(nullptr) : json(iterations)}};
    }

    json solve(const json& request) {
        Block b = block(request.at("rhs"));
        const unsigned warmup = request.at("warmup"), times = request.at("times");
        std::vector<long long> samples;
        for (unsigned r = 0; r < warmup + times; ++r) {
            const long long sample = solve_once(b);
            if (r >= warmup) samples.push_back(sample);
        }
        problem_->to_rows(b.input.data(), b.x.data(), b.k, b.output.data());
        const std::string path = request.at("solution");
        std::ofstream file(path, std::ios::binary);
        file.write(reinterpret_cast<const char*>(b.output.data()), static_cast<std::streamsize>(b.output.size() * sizeof(double)));
        if (!file.flush()) throw Refusal("failed", path + " cannot be written");
        return timed(samples);
    }

    json update(const json& request) {
        if (!problem_) throw Refusal("failed", "nothing is prepared");
        const auto values = ArrayFile(request.at("values")).doubles();
        const unsigned times = request.at("times");
        std::vector<long long> samples;
        for (unsigned r = 0; r < times; ++r) {
            const auto start = Clock::now();
            problem_->set_values(values);
            if (solver_) {
                solver_->set_values(problem_->system());
                solver_->factorise();
            }
            samples.push_back(nanoseconds_since(start));
        }
        return timed(samples);
    }

    // Latencies from the scheduled starts: a late frame makes the next ones late too.
    json open_loop(const json& request) {
        Block b = block(request.at("input"));
        const std::chrono::duration<double> period(1.0 / request.at("hz").get<double>());
        const long long limit = request.at("limit_ns");
        const unsigned frames = request.at("frames");
        std::vector<long long> samples;
        const auto begin = Clock::now();
        for (unsigned r = 0; r < frames && nanoseconds_since(begin) < limit; ++r) {
            const auto scheduled = begin + std::chrono::duration_cast<Clock::duration>(period * r);
            std::this_thread::sleep_until(scheduled - std::chrono::microseconds(300));  // sleeping ends late: spin the rest
            while (Clock::now() < scheduled) {}
            solve_once(b);
            samples.push_back(nanoseconds_since(scheduled));
        }
        return timed(samples);
    }

    json memory() const {
        json held = {{"peak_rss_bytes", peak_resident_bytes()}};
        if (solver_) {
            held["factor_nonzeros"] = static_cast<long long>(solver_->factor_entries());
            held["factor_bytes"] = static_cast<long long>(solver_->factor_bytes());
            if (solver_->reads_factor_once_per_sweep()) held["bytes_per_solve"] = static_cast<long long>(2 * solver_->factor_bytes());
        }
        return held;
    }

    std::string id_;
    int threads_ = 1;
    double tolerance_ = 1e-10;
    size_t max_columns_ = 1;
    std::unique_ptr<Problem> problem_;
    std::unique_ptr<Solver> solver_;
};

json refusal(const std::string& kind, const std::string& message) {
    return {{"error", {{"kind", kind}, {"message", message}}}};
}

json outcome(Server& server, const json& request) {
    try {
        return {{"ok", server.answer(request)}};
    } catch (const Refusal& why) {
        return refusal(why.kind, why.what());
    } catch (const std::bad_alloc&) {
        return refusal("out_of_memory", "out of memory");
    } catch (const std::exception& error) {
        return refusal("failed", error.what());
    }
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) {
        std::cerr << "usage: " << argv[0] << " ID\nsolvers:";
        for (const auto& id : solver_ids()) std::cerr << ' ' << id;
        std::cerr << '\n';
        return 2;
    }
    // Libraries print to stdout too; their words go to stderr, the answers where stdout was.
    std::FILE* answers = fdopen(dup(STDOUT_FILENO), "w");
    dup2(STDERR_FILENO, STDOUT_FILENO);
    Server server(argv[1]);
    for (std::string line; std::getline(std::cin, line);) {
        const json request = json::parse(line, nullptr, false);
        json answer = request.is_object() ? outcome(server, request) : refusal("failed", "not a request");
        answer["id"] = request.is_object() ? request.value("id", 0LL) : 0LL;
        std::fprintf(answers, "%s\n", answer.dump().c_str());
        std::fflush(answers);
        if (request.is_object() && request.value("do", "") == "quit") break;
    }
}
