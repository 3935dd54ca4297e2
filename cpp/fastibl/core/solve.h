// Solves small systems of equations, symmetric and positive definite, by Cholesky's factors.
// Matrices are stored row by row; the part of A above the diagonal is not read. False where A is
// not positive definite.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <span>

namespace fastibl {

// Replaces A by L of A = L Lᵀ; what is above the diagonal stays.
inline bool factor_symmetric(std::span<double> a, std::size_t n) {
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j <= i; ++j) {
      const double own = a[n * i + j];
      double sum = own;
      for (std::size_t k = 0; k < j; ++k) sum -= a[n * i + k] * a[n * j + k];
      if (i != j) {
        a[n * i + j] = sum / a[n * j + j];
      } else {
        if (!(sum > 1e-14 * own)) return false;
        a[n * i + i] = std::sqrt(sum);
      }
    }
  return true;
}

// Replaces b by x of L Lᵀ x = b.
inline void substitute(std::span<const double> l, std::span<double> b) {
  const std::size_t n = b.size();
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < i; ++k) b[i] -= l[n * i + k] * b[k];
    b[i] /= l[n * i + i];
  }
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t k = i + 1; k < n; ++k) b[i] -= l[n * k + i] * b[k];
    b[i] /= l[n * i + i];
  }
}

// Replaces b by x of A x = b; A becomes its factor L.
inline bool solve_in_place(std::span<double> a, std::span<double> b) {
  if (!factor_symmetric(a, b.size())) return false;
  substitute(a, b);
  return true;
}

// Solves A x = b.
template <std::size_t N>
bool solve_symmetric(std::array<double, N * N> a, const std::array<double, N>& b,
                     std::array<double, N>& x) {
  x = b;
  return solve_in_place(a, x);
}

// A⁻¹ B, where B has M columns.
template <std::size_t N, std::size_t M = N>
bool solve_columns(std::array<double, N * N> a, const std::array<double, N * M>& b,
                   std::array<double, N * M>& out) {
  if (!factor_symmetric(a, N)) return false;
  for (std::size_t c = 0; c < M; ++c) {
    std::array<double, N> x;
    for (std::size_t r = 0; r < N; ++r) x[r] = b[M * r + c];
    substitute(a, x);
    for (std::size_t r = 0; r < N; ++r) out[M * r + c] = x[r];
  }
  return true;
}

// A⁻¹ times `scale`.
template <std::size_t N>
bool invert(const std::array<double, N * N>& a, std::array<double, N * N>& out, double scale = 1) {
  std::array<double, N * N> b{};
  for (std::size_t i = 0; i < N; ++i) b[(N + 1) * i] = scale;
  return solve_columns<N>(a, b, out);
}

// J A Jᵀ.
template <std::size_t N>
std::array<double, N * N> carried(const std::array<double, N * N>& j,
                                  const std::array<double, N * N>& a) {
  std::array<double, N * N> half{}, out{};
  for (std::size_t i = 0; i < N; ++i)
    for (std::size_t k = 0; k < N; ++k) {
      if (j[N * i + k] == 0) continue;
      for (std::size_t m = 0; m < N; ++m) half[N * i + m] += j[N * i + k] * a[N * k + m];
    }
  for (std::size_t i = 0; i < N; ++i)
    for (std::size_t k = 0; k < N; ++k)
      for (std::size_t m = 0; m < N; ++m) out[N * i + k] += half[N * i + m] * j[N * k + m];
  return out;
}

}  // namespace fastibl
