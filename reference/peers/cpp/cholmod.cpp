// CHOLMOD of SuiteSparse, through its C interface with int indices.

#include <cholmod.h>

#include <cstring>

#include "solver.hpp"

extern "C" void openblas_set_num_threads(int);

namespace {

class Cholmod final : public Solver {
  public:
    Cholmod(bool supernodal, bool metis, int threads) {
        cholmod_start(&common_);
        common_.supernodal = supernodal ? CHOLMOD_SUPERNODAL : CHOLMOD_SIMPLICIAL;
        common_.nmethods = 1;  // exactly this ordering, not the best of several
        common_.method[0].ordering = metis ? CHOLMOD_METIS : CHOLMOD_AMD;
        common_.postorder = 1;
        common_.print = 0;
        openblas_set_num_threads(threads);  // the BLAS under the supernodal code; the simplicial code has no threads
    }

    ~Cholmod() override {
        cholmod_free_dense(&x_, &common_);
        cholmod_free_dense(&y_, &common_);
        cholmod_free_dense(&e_, &common_);
        cholmod_free_factor(&factor_, &common_);
        cholmod_free_sparse(&matrix_, &common_);
        cholmod_finish(&common_);
    }

    std::string version() const override {
        return "CHOLMOD " + std::to_string(CHOLMOD_MAIN_VERSION) + "." + std::to_string(CHOLMOD_SUB_VERSION) + "." +
               std::to_string(CHOLMOD_SUBSUB_VERSION);
    }

    void analyse(const System& a) override {
        const size_t entries = a.values.size();
        const int lower = -1;
        matrix_ = cholmod_allocate_sparse(a.n, a.n, entries, 1, 1, lower, CHOLMOD_REAL, &common_);
        check("store the matrix");
        std::memcpy(matrix_->p, a.starts.data(), a.starts.size() * sizeof(int));
        std::memcpy(matrix_->i, a.indices.data(), entries * sizeof(int));
        set_values(a);
        factor_ = cholmod_analyze(matrix_, &common_);
        check("analyse");
        entries_ = common_.lnz;
    }

    void set_values(const System& a) override { std::memcpy(matrix_->x, a.values.data(), a.values.size() * sizeof(double)); }

    void factorise() override {
        cholmod_factorize(matrix_, factor_, &common_);
        check("factorise");
        if (factor_->minor < factor_->n) throw Refusal("not_positive_definite", "not positive definite in row " + std::to_string(factor_->minor));
    }

    // cholmod_solve2 keeps x and its workspaces between calls, so that no memory is allocated from the second on.
    void solve(const double* b, double* x, int k) override {
        const size_t n = matrix_->nrow;
        cholmod_dense right{};
        right.nrow = right.d = n;
        right.ncol = k;
        right.nzmax = n * k;
        right.x = const_cast<double*>(b);
        right.xtype = CHOLMOD_REAL;
        right.dtype = CHOLMOD_DOUBLE;
        cholmod_solve2(CHOLMOD_A, factor_, &right, nullptr, &x_, nullptr, &y_, &e_, &common_);
        check("solve");
        std::memcpy(x, x_->x, n * k * sizeof(double));
    }

    double factor_entries() const override { return entries_; }

    double factor_bytes() const override {
        const double numbers = factor_->is_super ? factor_->xsize : factor_->nzmax;
        const double indices = factor_->is_super ? factor_->ssize : factor_->nzmax;
        return numbers * sizeof(double) + indices * sizeof(int);
    }

    // The simplicial code does up to four columns in one pass, the supernodal code all.
    bool reads_factor_once_per_sweep() const override { return true; }

  private:
    void check(const char* step) const {
        if (common_.status == CHOLMOD_OUT_OF_MEMORY) throw Refusal("out_of_memory", std::string("CHOLMOD cannot ") + step);
        if (common_.status < CHOLMOD_OK)
            throw Refusal("failed", std::string("CHOLMOD cannot ") + step + ", status " + std::to_string(common_.status));
    }

    cholmod_common common_{};
    cholmod_sparse* matrix_ = nullptr;
    cholmod_factor* factor_ = nullptr;
    cholmod_dense *x_ = nullptr, *y_ = nullptr, *e_ = nullptr;
    double entries_ = 0;
};

}  // namespace

std::unique_ptr<Solver> open_cholmod(bool supernodal, bool metis, int threads) {
    return std::make_unique<Cholmod>(supernodal, metis, threads);
}
