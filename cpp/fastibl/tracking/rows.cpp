#include "fastibl/tracking/rows.h"

#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/solve.h"

namespace fastibl {
namespace {

constexpr std::size_t kAll = kRowParameters;

// Matrix from the state to that a share of the readout later: the pose changes with the motion.
// Axes turn by a degree or two meanwhile, which is left out.
RowMatrix step(double share) {
  RowMatrix f{};
  for (std::size_t i = 0; i < kAll; ++i) f[(kAll + 1) * i] = 1;
  for (std::size_t i = 0; i < 6; ++i) {
    f[kAll * i + 6 + i] = f[kAll * (6 + i) + 12 + i] = share;
    f[kAll * i + 12 + i] = 0.5 * share * share;
  }
  return f;
}

RowMatrix transposed(const RowMatrix& a) {
  RowMatrix out{};
  for (std::size_t i = 0; i < kAll; ++i)
    for (std::size_t k = 0; k < kAll; ++k) out[kAll * i + k] = a[kAll * k + i];
  return out;
}

// J Jᵀ of turns and shifts about the camera, by the six of (w, d): d = shift + w × place.
std::array<double, 36> about_board(const Unsteadiness& by, const glm::dvec3& p) {
  const double turn = by.turn, shift = by.shift;
  const double j[6][6] = {
      {turn, 0, 0},
      {0, turn, 0},
      {0, 0, turn},
      {0, turn * p.z, -turn * p.y, shift, 0, 0},
      {-turn * p.z, 0, turn * p.x, 0, shift, 0},
      {turn * p.y, -turn * p.x, 0, 0, 0, shift},
  };
  std::array<double, 36> out{};
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t m = 0; m < 6; ++m) out[6 * i + k] += j[i][m] * j[k][m];
  return out;
}

}  // namespace

// A point is seen in the row that is taken when it is there. Two guesses tell how it runs through
// the rows, and where it meets its own: to second order, 1e-4 px at 60 degrees a second.
std::optional<Rows::Seen> Rows::project(const Lens& lens, const glm::dvec3& point,
                                        double guess) const {
  const auto first = lens.project(motion.moved(point, guess));
  if (!first) return std::nullopt;
  constexpr double kStep = 0.02;
  const double second = later(first->y),
               step = std::abs(second - guess) > kStep ? second - guess : kStep;
  const auto next = lens.project(motion.moved(point, guess + step));
  if (!next) return std::nullopt;
  const glm::dvec2 flow = (*next - *first) / step;
  const double crossing = 1 - flow.y / height;  // 0: the row follows the point
  if (!(crossing > 0.1)) return std::nullopt;
  const double own = guess + step + (later(next->y) - guess - step) / crossing;
  return Seen{*next + (own - guess - step) * flow, flow, own};
}

std::optional<glm::dvec2> Rows::project(const Lens& lens, const glm::dvec3& point, double guess,
                                        const glm::dvec2& flow) const {
  auto pixel = lens.project(motion.moved(point, guess));
  if (pixel) *pixel += (later(pixel->y) - guess) / (1 - flow.y / height) * flow;
  return pixel;
}

RowState state_of_row(const RowState& state, double share) {
  return {state.motion.moved(state.pose, share), state.motion.seen_from(share),
          carried<kAll>(step(share), state.covariance)};
}

RowState after(const RowState& state, double steps, const Unsteadiness& jerk) {
  RowState out = state_of_row(state, steps);
  const auto noise = about_board(jerk, out.pose.translation);
  const double grown[3] = {steps * steps * steps / 6, 0.5 * steps * steps, steps};
  for (std::size_t i = 0; i < kAll; ++i)
    for (std::size_t k = 0; k < kAll; ++k)
      out.covariance[kAll * i + k] += grown[i / 6] * grown[k / 6] * noise[6 * (i % 6) + k % 6];
  return out;
}

RowPrior unknown_motion(const Pose& start, const RowMotion& motion, const Unsteadiness& speed,
                        const Unsteadiness& acceleration, const Unsteadiness& jerk) {
  RowPrior out{start, motion, {}, jerk};
  for (const std::size_t at : {std::size_t{6}, std::size_t{12}}) {
    const auto known = steadiness(at == 6 ? speed : acceleration, start.translation);
    for (std::size_t i = 0; i < 6; ++i)
      for (std::size_t k = 0; k < 6; ++k)
        out.information[kAll * (at + i) + at + k] = known[6 * i + k];
  }
  return out;
}

std::optional<RowPrior> prior_of(const RowState& state, const Unsteadiness& jerk) {
  RowPrior out{state.pose, state.motion, {}, jerk};
  if (!invert<kAll>(state.covariance, out.information)) return std::nullopt;
  return out;
}

RowPrior prior_of_row(const RowPrior& prior, double share) {
  return {prior.motion.moved(prior.pose, share), prior.motion.seen_from(share),
          carried<kAll>(transposed(step(-share)), prior.information), prior.jerk};
}

std::array<double, 36> steadiness(const Unsteadiness& by, const glm::dvec3& place) {
  std::array<double, 36> known{};
  check(invert<6>(about_board(by, place), known), "unsteadiness must be positive, got ", by.turn,
        " and ", by.shift);
  return known;
}

// With information A of the pose, C of both and D of the motion, the motion's covariance is
// V = (D - Cᵀ A⁻¹ C)⁻¹, and the pose goes with it by G = -A⁻¹ C. In all: K + G V Gᵀ, G V and V;
// K is that of a known motion. The jerk is part of the motion here, and is left out of the result.
std::optional<RowMatrix> joint_covariance(const UnknownMatrix& information, double variance,
                                          const std::array<double, 36>& known) {
  constexpr std::size_t n = kRowUnknowns, m = n - 6;
  std::array<double, 36> a{};
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k) a[6 * i + k] = information[n * i + k];
  std::array<double, 6 * m> g{};
  for (std::size_t r = 0; r < 6; ++r)
    for (std::size_t c = 0; c < m; ++c) g[m * r + c] = -information[n * r + 6 + c];
  if (!solve_columns<6, m>(a, g, g)) return std::nullopt;
  double mixed[6][m];
  std::array<double, m * m> own{}, v{};
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t k = 0; k < m; ++k) {
      own[m * i + k] = information[n * (6 + i) + 6 + k];
      for (std::size_t r = 0; r < 6; ++r)
        own[m * i + k] += information[n * r + 6 + i] * g[m * r + k];
    }
  if (!invert<m>(own, v)) return std::nullopt;
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < m; ++k) {
      mixed[i][k] = 0;
      for (std::size_t r = 0; r < m; ++r) mixed[i][k] += variance * g[m * i + r] * v[m * r + k];
    }
  RowMatrix out{};
  for (std::size_t i = 0; i < 12; ++i)
    for (std::size_t k = 0; k < 12; ++k) out[kAll * (6 + i) + 6 + k] = variance * v[m * i + k];
  for (std::size_t i = 0; i < 6; ++i) {
    for (std::size_t k = 0; k < 12; ++k)
      out[kAll * i + 6 + k] = out[kAll * (6 + k) + i] = mixed[i][k];
    for (std::size_t k = 0; k < 6; ++k) {
      out[kAll * i + k] = known[6 * i + k];
      for (std::size_t r = 0; r < m; ++r) out[kAll * i + k] += mixed[i][r] * g[m * k + r];
    }
  }
  return out;
}

// A motion that is told about the camera is another one about the board.
std::array<double, 12> difference(const RowMotion& to, const RowMotion& from,
                                  const glm::dvec3& place) {
  const glm::dvec3 w = to.turn - from.turn, d = to.shift - from.shift + glm::cross(w, place);
  const glm::dvec3 a = to.turning - from.turning,
                   b = to.shifting - from.shifting + glm::cross(a, place);
  return {w.x, w.y, w.z, d.x, d.y, d.z, a.x, a.y, a.z, b.x, b.y, b.z};
}

RowMotion changed(const RowMotion& motion, std::span<const double, 12> x, const glm::dvec3& place) {
  const glm::dvec3 w(x[0], x[1], x[2]), d(x[3], x[4], x[5]), a(x[6], x[7], x[8]),
      b(x[9], x[10], x[11]);
  return {motion.turn + w, motion.shift + d - glm::cross(w, place), motion.turning + a,
          motion.shifting + b - glm::cross(a, place)};
}

}  // namespace fastibl
