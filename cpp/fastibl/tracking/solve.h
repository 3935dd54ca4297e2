// Small symmetric systems of equations.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace fastibl {

// L of A = L Lᵀ, for symmetric positive definite A (row major). False where it is not.
template <std::size_t N>
bool factor(const std::array<double, N * N>& a, std::array<double, N * N>& l) {
  l.fill(0);
  for (std::size_t i = 0; i < N; ++i)
    for (std::size_t j = 0; j <= i; ++j) {
      double sum = a[N * i + j];
      for (std::size_t k = 0; k < j; ++k) sum -= l[N * i + k] * l[N * j + k];
      if (i != j) {
        l[N * i + j] = sum / l[N * j + j];
      } else {
        if (!(sum > 1e-14 * a[N * i + i])) return false;
        l[N * i + i] = std::sqrt(sum);
      }
    }
  return true;
}

// Solves L Lᵀ x = b.
template <std::size_t N>
void substitute(const std::array<double, N * N>& l, const std::array<double, N>& b,
                std::array<double, N>& x) {
  for (std::size_t i = 0; i < N; ++i) {
    double sum = b[i];
    for (std::size_t k = 0; k < i; ++k) sum -= l[N * i + k] * x[k];
    x[i] = sum / l[N * i + i];
  }
  for (std::size_t i = N; i-- > 0;) {
    double sum = x[i];
    for (std::size_t k = i + 1; k < N; ++k) sum -= l[N * k + i] * x[k];
    x[i] = sum / l[N * i + i];
  }
}

// Solves A x = b for symmetric positive definite A (row major). False where it is not.
template <std::size_t N>
bool solve_symmetric(const std::array<double, N * N>& a, const std::array<double, N>& b,
                     std::array<double, N>& x) {
  std::array<double, N * N> l;
  if (!factor<N>(a, l)) return false;
  substitute<N>(l, b, x);
  return true;
}

// A⁻¹ B of symmetric positive definite A. Row major.
template <std::size_t N>
bool solve_columns(const std::array<double, N * N>& a, const std::array<double, N * N>& b,
                   std::array<double, N * N>& out) {
  std::array<double, N * N> l;
  if (!factor<N>(a, l)) return false;
  for (std::size_t c = 0; c < N; ++c) {
    std::array<double, N> right{}, x{};
    for (std::size_t r = 0; r < N; ++r) right[r] = b[N * r + c];
    substitute<N>(l, right, x);
    for (std::size_t r = 0; r < N; ++r) out[N * r + c] = x[r];
  }
  return true;
}

template <std::size_t N>
bool invert(const std::array<double, N * N>& a, std::array<double, N * N>& out) {
  std::array<double, N * N> one{};
  for (std::size_t i = 0; i < N; ++i) one[(N + 1) * i] = 1;
  return solve_columns<N>(a, one, out);
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
