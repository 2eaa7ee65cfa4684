// Eigen's sparse solvers with their default ordering (AMD).

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <algorithm>

#include "solver.hpp"

namespace {

using Sparse = Eigen::SparseMatrix<double>;
using Dense = Eigen::Map<Eigen::MatrixXd>;
using ConstDense = Eigen::Map<const Eigen::MatrixXd>;

std::string eigen_version() {
    return "Eigen " + std::to_string(EIGEN_WORLD_VERSION) + "." + std::to_string(EIGEN_MAJOR_VERSION) + "." +
           std::to_string(EIGEN_MINOR_VERSION);
}

Sparse lower_triangle(const System& a) {
    return Eigen::Map<const Sparse>(a.n, a.n, a.values.size(), a.starts.data(), a.indices.data(), a.values.data());
}

// `unit_diagonal`: the factor's diagonal of ones is not stored, but counts like that of LL'.
template <class Cholesky, bool unit_diagonal>
class Direct final : public Solver {
  public:
    std::string version() const override { return eigen_version(); }

    void analyse(const System& a) override {
        matrix_ = lower_triangle(a);
        cholesky_.analyzePattern(matrix_);
    }

    void set_values(const System& a) override { std::copy(a.values.begin(), a.values.end(), matrix_.valuePtr()); }

    void factorise() override {
        cholesky_.factorize(matrix_);
        if (cholesky_.info() != Eigen::Success) throw Refusal("not_positive_definite", "not positive definite");
        const auto stored = cholesky_.matrixL().nestedExpression().nonZeros();
        entries_ = static_cast<double>(stored + (unit_diagonal ? matrix_.rows() : 0));
    }

    void solve(const double* b, double* x, int k) override {
        Dense(x, matrix_.rows(), k) = cholesky_.solve(ConstDense(b, matrix_.rows(), k));
    }

    double factor_entries() const override { return entries_; }
    double factor_bytes() const override { return entries_ * (sizeof(double) + sizeof(int)); }

  private:
    Sparse matrix_;
    Cholesky cholesky_;
    double entries_ = 0;
};

// Both triangles by rows: the form in which Eigen multiplies with several threads.
class ConjugateGradient final : public Solver {
  public:
    explicit ConjugateGradient(double tolerance) { cg_.setTolerance(tolerance); }

    std::string version() const override { return eigen_version(); }

    void analyse(const System& a) override {
        set_values(a);
        cg_.analyzePattern(matrix_);
    }

    void set_values(const System& a) override { matrix_ = lower_triangle(a).selfadjointView<Eigen::Lower>(); }

    void factorise() override {
        cg_.factorize(matrix_);
        if (cg_.info() != Eigen::Success) throw Refusal("failed", "the incomplete factorisation failed");
    }

    void solve(const double* b, double* x, int k) override {
        iterations_ = 0;
        for (int j = 0; j < k; ++j) {
            const Eigen::Index n = matrix_.rows();
            Eigen::Map<Eigen::VectorXd>(x + n * j, n) = cg_.solve(Eigen::Map<const Eigen::VectorXd>(b + n * j, n));
            iterations_ = std::max(iterations_, static_cast<int>(cg_.iterations()));
            if (cg_.info() != Eigen::Success)
                throw Refusal("not_converged", std::to_string(cg_.iterations()) + " iterations, residual " + std::to_string(cg_.error()));
        }
    }

    double factor_entries() const override { return static_cast<double>(cg_.preconditioner().matrixL().nonZeros()); }
    double factor_bytes() const override { return factor_entries() * (sizeof(double) + sizeof(int)); }
    int iterations() const override { return iterations_; }

  private:
    using Rows = Eigen::SparseMatrix<double, Eigen::RowMajor>;
    Rows matrix_;
    Eigen::ConjugateGradient<Rows, Eigen::Lower | Eigen::Upper, Eigen::IncompleteCholesky<double>> cg_;
    int iterations_ = 0;
};

}  // namespace

std::unique_ptr<Solver> open_eigen(const std::string& kind, int threads, double tolerance) {
    Eigen::setNbThreads(threads);
    if (kind != "cg-ic" && kind != "llt" && kind != "ldlt") throw Refusal("unavailable", "Eigen has no " + kind);
    if (kind == "llt") return std::make_unique<Direct<Eigen::SimplicialLLT<Sparse>, false>>();
    if (kind == "ldlt") return std::make_unique<Direct<Eigen::SimplicialLDLT<Sparse>, true>>();
    return std::make_unique<ConjugateGradient>(tolerance);
}
