#include "fastibl/tracking/rows.h"

#include "fastibl/tracking/solve.h"

namespace fastibl {
namespace {

constexpr std::size_t kAll = kRowParameters;

// Of the state a share of the readout later: the pose changes with the motion. Axes turn by a
// degree or two meanwhile, which is left out.
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
std::optional<glm::dvec2> Rows::project(const Lens& lens, const glm::dvec3& point,
                                        double& later) const {
  const auto at = lens.project(motion.moved(point, later));
  if (!at) return std::nullopt;
  const double second = this->later(at->y), step = second - later;
  if (!(step * step > 1e-18)) return at;
  const auto next = lens.project(motion.moved(point, second));
  if (!next) return std::nullopt;
  const glm::dvec2 flow = (*next - *at) / step;
  const double crossing = 1 - flow.y / height;  // 0: the row follows the point
  if (!(crossing > 0.1)) return std::nullopt;
  later = second + (this->later(next->y) - second) / crossing;
  return *next + (later - second) * flow;
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
                        const Unsteadiness& acceleration) {
  RowPrior out{start, motion, {}};
  for (const std::size_t at : {std::size_t{6}, std::size_t{12}}) {
    const auto covariance = about_board(at == 6 ? speed : acceleration, start.translation);
    std::array<double, 36> known{};
    if (!invert<6>(covariance, known)) continue;
    for (std::size_t i = 0; i < 6; ++i)
      for (std::size_t k = 0; k < 6; ++k)
        out.information[kAll * (at + i) + at + k] = known[6 * i + k];
  }
  return out;
}

std::optional<RowPrior> prior_of(const RowState& state) {
  RowPrior out{state.pose, state.motion, {}};
  if (!invert<kAll>(state.covariance, out.information)) return std::nullopt;
  return out;
}

RowPrior prior_of_row(const RowPrior& prior, double share) {
  return {prior.motion.moved(prior.pose, share), prior.motion.seen_from(share),
          carried<kAll>(transposed(step(-share)), prior.information)};
}

// With information A of the pose, C of both and D of the motion, the motion's covariance is
// V = (D - Cᵀ A⁻¹ C)⁻¹ and the pose goes with it by G = -A⁻¹ C: in all K + G V Gᵀ, G V and V, K
// that of a known motion.
std::optional<RowMatrix> joint_covariance(const RowMatrix& information, double variance,
                                          const std::array<double, 36>& known) {
  std::array<double, 36> a{};
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k) a[6 * i + k] = information[kAll * i + k];
  double g[6][12];
  std::array<double, 144> own{}, v{};
  for (std::size_t c = 0; c < 12; ++c) {
    std::array<double, 6> right{}, x{};
    for (std::size_t r = 0; r < 6; ++r) right[r] = -information[kAll * r + 6 + c];
    if (!solve_symmetric<6>(a, right, x)) return std::nullopt;
    for (std::size_t r = 0; r < 6; ++r) g[r][c] = x[r];
  }
  for (std::size_t i = 0; i < 12; ++i)
    for (std::size_t k = 0; k < 12; ++k) {
      own[12 * i + k] = information[kAll * (6 + i) + 6 + k];
      for (std::size_t m = 0; m < 6; ++m)
        own[12 * i + k] += information[kAll * m + 6 + i] * g[m][k];
    }
  if (!invert<12>(own, v)) return std::nullopt;
  RowMatrix out{};
  for (std::size_t i = 0; i < 12; ++i)
    for (std::size_t k = 0; k < 12; ++k) out[kAll * (6 + i) + 6 + k] = variance * v[12 * i + k];
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 12; ++k) {
      double sum = 0;
      for (std::size_t m = 0; m < 12; ++m) sum += g[i][m] * v[12 * m + k];
      out[kAll * i + 6 + k] = out[kAll * (6 + k) + i] = variance * sum;
    }
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k) {
      double sum = known[6 * i + k];
      for (std::size_t m = 0; m < 12; ++m) sum += out[kAll * i + 6 + m] * g[k][m];
      out[kAll * i + k] = sum;
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
