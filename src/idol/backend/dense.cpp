#include "idol/backend/dense.hpp"

#include <algorithm>
#include <stdexcept>
#include <vector>

// Fortran's names: the same in every BLAS and LAPACK.
extern "C" {
void dgemm_(const char* trans_a, const char* trans_b, const int* m, const int* n, const int* k,
            const double* alpha, const double* a, const int* lda, const double* b, const int* ldb,
            const double* beta, double* c, const int* ldc);
void dsyrk_(const char* uplo, const char* trans, const int* n, const int* k, const double* alpha,
            const double* a, const int* lda, const double* beta, double* c, const int* ldc);
void dtrsm_(const char* side, const char* uplo, const char* trans, const char* diag, const int* m,
            const int* n, const double* alpha, const double* a, const int* lda, double* b, const int* ldb);
void dgeqrf_(const int* m, const int* n, double* a, const int* lda, double* tau, double* work,
             const int* lwork, int* info);
void dpotrf_(const char* uplo, const int* n, double* a, const int* lda, int* info);
}

namespace idol {
namespace {

constexpr double kOne = 1, kMinusOne = -1;

int as_int(Eigen::Index i) { return static_cast<int>(i); }

void expect(bool fits) {
  if (!fits) throw std::invalid_argument("idol: matrices whose sizes do not fit");
}

}  // namespace

void subtract_product(Eigen::Ref<Eigen::MatrixXd> C, const Eigen::Ref<const Eigen::MatrixXd>& A,
                      const Eigen::Ref<const Eigen::MatrixXd>& B) {
  expect(C.rows() == A.cols() && C.cols() == B.cols() && A.rows() == B.rows());
  if (C.size() == 0 || A.rows() == 0) return;
  const int m = as_int(C.rows()), n = as_int(C.cols()), k = as_int(A.rows());
  const int lda = as_int(A.outerStride()), ldb = as_int(B.outerStride()), ldc = as_int(C.outerStride());
  dgemm_("T", "N", &m, &n, &k, &kMinusOne, A.data(), &lda, B.data(), &ldb, &kOne, C.data(), &ldc);
}

void subtract_gram(Eigen::Ref<Eigen::MatrixXd> C, const Eigen::Ref<const Eigen::MatrixXd>& W) {
  expect(C.rows() == W.cols() && C.cols() == W.cols());
  if (W.size() == 0) return;
  const int n = as_int(C.rows()), k = as_int(W.rows());
  const int ldw = as_int(W.outerStride()), ldc = as_int(C.outerStride());
  dsyrk_("L", "T", &n, &k, &kMinusOne, W.data(), &ldw, &kOne, C.data(), &ldc);
}

Eigen::MatrixXd gram(const Eigen::Ref<const Eigen::MatrixXd>& A) {
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(A.cols(), A.cols());
  if (A.size() == 0) return out;
  const int n = as_int(A.cols()), k = as_int(A.rows()), lda = as_int(A.outerStride());
  dsyrk_("L", "T", &n, &k, &kOne, A.data(), &lda, &kOne, out.data(), &n);
  out.triangularView<Eigen::StrictlyUpper>() = out.transpose();
  return out;
}

bool factor_lower(Eigen::Ref<Eigen::MatrixXd> A) {
  expect(A.rows() == A.cols());
  if (A.size() == 0) return true;
  const int n = as_int(A.rows()), lda = as_int(A.outerStride());
  int info = 0;
  dpotrf_("L", &n, A.data(), &lda, &info);
  return info == 0 && A.diagonal().allFinite();
}

void replace_by_triangular_factor(Eigen::MatrixXd& A) {
  if (A.size() == 0) return;
  const int m = as_int(A.rows()), n = as_int(A.cols()), least = std::min(m, n), ask = -1;
  std::vector<double> tau(static_cast<std::size_t>(least));
  int info = 0;
  double wanted = 0;
  dgeqrf_(&m, &n, A.data(), &m, tau.data(), &wanted, &ask, &info);
  const int size = std::max(n, static_cast<int>(wanted));
  std::vector<double> work(static_cast<std::size_t>(size));
  dgeqrf_(&m, &n, A.data(), &m, tau.data(), work.data(), &size, &info);
  A = A.topRows(least).triangularView<Eigen::Upper>().toDenseMatrix().eval();
}

void solve_lower(const Eigen::Ref<const Eigen::MatrixXd>& L, Eigen::Ref<Eigen::MatrixXd> B) {
  expect(L.rows() == L.cols() && L.cols() == B.rows());
  if (B.size() == 0) return;
  const int m = as_int(B.rows()), n = as_int(B.cols());
  const int lda = as_int(L.outerStride()), ldb = as_int(B.outerStride());
  dtrsm_("L", "L", "N", "N", &m, &n, &kOne, L.data(), &lda, B.data(), &ldb);
}

}  // namespace idol
