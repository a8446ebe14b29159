// Products and factors of matrices with hundreds of rows, by the machine's BLAS and LAPACK: OpenBLAS, which
// scripts/packages.txt installs, picks kernels for the CPU it runs on. For small or fixed sizes Eigen is
// faster.
#pragma once

#include <Eigen/Core>

namespace idol {

/// C -= A' B. Throws std::invalid_argument if the sizes do not fit (so do the others).
void subtract_product(Eigen::Ref<Eigen::MatrixXd> C, const Eigen::Ref<const Eigen::MatrixXd>& A,
                      const Eigen::Ref<const Eigen::MatrixXd>& B);
/// C -= W' W, in the lower half of C only.
void subtract_gram(Eigen::Ref<Eigen::MatrixXd> C, const Eigen::Ref<const Eigen::MatrixXd>& W);
/// A' A.
[[nodiscard]] Eigen::MatrixXd gram(const Eigen::Ref<const Eigen::MatrixXd>& A);
/// Cholesky factor L of A = L L', in the place of A's lower half, which alone is read. False if A is not
/// positive.
[[nodiscard]] bool factor_lower(Eigen::Ref<Eigen::MatrixXd> A);
/// A = Q R with orthonormal columns of Q: R takes A's place, with as many rows as are not zero below the
/// diagonal, at most A's. A' A = R' R.
void replace_by_triangular_factor(Eigen::MatrixXd& A);
/// B = L^-1 B, L in a lower half.
void solve_lower(const Eigen::Ref<const Eigen::MatrixXd>& L, Eigen::Ref<Eigen::MatrixXd> B);

}  // namespace idol
