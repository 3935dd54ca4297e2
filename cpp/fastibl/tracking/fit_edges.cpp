#include "fastibl/tracking/fit_edges.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "fastibl/core/simd.h"
#include "fastibl/tracking/fit.h"

namespace fastibl {
namespace {

constexpr int kWeightings = 3;
constexpr std::size_t kLeastPoints = 8, kLeastOfKind = 24, kScalePoints = 400;
constexpr std::size_t kKinds = 8;
constexpr double kTukey = 4.685;      // 95 % efficient for normal errors
constexpr float kLeastNoise = 2e-3f;  // px: exact pictures must not divide by zero
constexpr double kLeastGrowth = 0.1;  // px: less is left to cancel out between opposite edges
constexpr double kFarCost = 25;       // of a point: no nearer than five times its noise

using Row = std::array<double, 6>;

// How a point moves across its edge with (w, d).
std::optional<Row> row_of(const EdgePoint& p, const Lens& lens, const Pose& pose,
                          glm::dvec2* pixel = nullptr) {
  const glm::dvec3 turned = pose.rotation * glm::dvec3(p.point, 0);
  glm::dmat2x3 d;
  const auto at = lens.project(turned + pose.translation, &d);
  if (!at) return std::nullopt;
  if (pixel) *pixel = *at;
  const glm::dvec3 g = p.normal.x * d[0] + p.normal.y * d[1], r = glm::cross(turned, g);
  return Row{r.x, r.y, r.z, g.x, g.y, g.z};
}

typedef double Doubles __attribute__((vector_size(64), aligned(8)));
constexpr std::size_t kDoubles = 8;

// Adds the part right of First of row i of the sums of w r rᵀ to a.
template <std::size_t First>
FASTIBL_INLINE void add_row(const double* rows, const double* weights, std::size_t count,
                            std::size_t i, double* a) {
  constexpr std::size_t n = (kRowUnknowns - First) / kDoubles;
  Doubles sums[n] = {};
  for (std::size_t p = 0; p < count; ++p) {
    const double* row = rows + kRowUnknowns * p;
    const double w = weights[p] * row[i];
    for (std::size_t k = 0; k < n; ++k)
      sums[k] += w * *reinterpret_cast<const Doubles*>(row + First + kDoubles * k);
  }
  for (std::size_t k = 0; k < n; ++k)
    *reinterpret_cast<Doubles*>(a + kRowUnknowns * i + First + kDoubles * k) += sums[k];
}

// Sums of w r rᵀ of rows r with weights w, added to a: of its upper triangle and a little more.
FASTIBL_CLONES void add_products(const double* rows, const double* weights, std::size_t count,
                                 double* a) {
  static_assert(kRowUnknowns == 3 * kDoubles);
  constexpr std::size_t kChunk = 64;  // rows that stay in the nearest cache
  for (std::size_t p = 0; p < count; p += kChunk) {
    const double *r = rows + kRowUnknowns * p, *w = weights + p;
    const std::size_t n = count - p < kChunk ? count - p : kChunk;
    for (std::size_t i = 0; i < 8; ++i) add_row<0>(r, w, n, i, a);
    for (std::size_t i = 8; i < 16; ++i) add_row<8>(r, w, n, i, a);
    for (std::size_t i = 16; i < 24; ++i) add_row<16>(r, w, n, i, a);
  }
}

template <std::size_t N>
struct Normal {
  std::array<double, N * N> a{};
  std::array<double, N> b{};
  void add(const std::array<double, N>& j, double weight, double value) {
    for (std::size_t i = 0; i < N; ++i) {
      const double w = weight * j[i];
      b[i] += w * value;
      for (std::size_t k = i; k < N; ++k) a[N * i + k] += w * j[k];
    }
  }
  void add_all(const std::vector<std::array<double, N>>& rows, const std::vector<double>& weights,
               std::span<const EdgePoint> points) {
    if constexpr (N == kRowUnknowns) {
      add_products(rows.data()->data(), weights.data(), rows.size(), a.data());
      for (std::size_t p = 0; p < rows.size(); ++p)
        for (std::size_t i = 0; i < N; ++i) b[i] += weights[p] * points[p].offset * rows[p][i];
    } else {
      for (std::size_t p = 0; p < rows.size(); ++p)
        if (weights[p] > 0) add(rows[p], weights[p], points[p].offset);
    }
  }
  // What stays known if all points may share a shift along their normals, of any size.
  struct Shift {
    std::array<double, N> with{};  // the motion
    double alone = 0, value = 0;
  };
  Shift without_shift(const std::vector<std::array<double, N>>& rows,
                      const std::vector<double>& weights, std::span<const EdgePoint> points) {
    Shift s;
    for (std::size_t p = 0; p < rows.size(); ++p) {
      if (!(weights[p] > 0)) continue;
      for (std::size_t i = 0; i < N; ++i) s.with[i] += weights[p] * rows[p][i];
      s.alone += weights[p], s.value += weights[p] * points[p].offset;
    }
    if (!(s.alone > 0)) return s;
    for (std::size_t i = 0; i < N; ++i) {
      const double share = s.with[i] / s.alone;
      b[i] -= share * s.value;
      for (std::size_t k = i; k < N; ++k) a[N * i + k] -= share * s.with[k];
    }
    return s;
  }
  void mirror() {
    for (std::size_t i = 0; i < N; ++i)
      for (std::size_t k = 0; k < i; ++k) a[N * i + k] = a[N * k + i];
  }
};

float median(std::vector<float>& values) {
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

template <std::size_t N>
double dot(const std::array<double, N>& a, const std::array<double, N>& b) {
  double sum = a[0] * b[0];
  for (std::size_t k = 1; k < N; ++k) sum += a[k] * b[k];
  return sum;
}

template <std::size_t N>
bool finite(const std::array<double, N>& x) {
  double sum = 0;
  for (const double v : x) sum += std::abs(v);
  return std::isfinite(sum);
}

// Deviation of points relative to their noise, for each kind: 1.4826 medians, of all points where a
// kind is rare. A share of the points is precise enough.
std::array<float, kKinds> scales_of(std::span<const EdgePoint> points,
                                    const std::vector<float>& residual, float floor) {
  std::array<std::vector<float>, kKinds> sizes;
  std::vector<float> together;
  const std::size_t step = std::max<std::size_t>(1, points.size() / kScalePoints);
  together.reserve(points.size() / step + 1);
  for (std::size_t i = 0; i < points.size(); i += step) {
    sizes[std::size_t(points[i].kind)].push_back(std::abs(residual[i]));
    together.push_back(std::abs(residual[i]));
  }
  const float all = std::max(1.4826f * median(together), floor);
  std::array<float, kKinds> scales{};
  for (std::size_t k = 0; k < kKinds; ++k)
    scales[k] =
        sizes[k].size() < kLeastOfKind ? all : std::max(1.4826f * median(sizes[k]), 0.3f * all);
  return scales;
}

}  // namespace

Pose moved(const Pose& pose, const std::array<double, 6>& x) {
  Pose next{rotation_from_vector({x[0], x[1], x[2]}) * pose.rotation,
            pose.translation + glm::dvec3(x[3], x[4], x[5])};
  // Takes out the rounding of many small turns.
  glm::dmat3& r = next.rotation;
  r[0] = glm::normalize(r[0]);
  r[1] = glm::normalize(r[1] - glm::dot(r[0], r[1]) * r[0]);
  r[2] = glm::cross(r[0], r[1]);
  return next;
}

namespace {

// rows: how the points move with N parameters, the first six of which are (w, d). prior: what is
// known of them beside the points. Also sums up the information of all, by the points' deviations.
template <std::size_t N>
std::optional<EdgeFit> fit(std::span<const EdgePoint> points,
                           const std::vector<std::array<double, N>>& rows, const Normal<N>& prior,
                           std::array<double, N>& x, Normal<N>& information) {
  const std::size_t count = points.size();
  std::vector<float> residual(count), sizes;
  const std::size_t few = std::max<std::size_t>(1, count / kScalePoints);
  std::vector<double> weights(count);
  // The points' noise in pixels sets the floor of their scatter.
  double noise = 0;
  for (const EdgePoint& p : points) noise += p.noise;
  const float floor = float(kLeastNoise * double(count) / noise);
  EdgeFit fit;
  fit.deviation.resize(count), fit.used.resize(count), fit.left.resize(count);
  x = {};
  bool grown = false;
  for (int round = 0; round < kWeightings; ++round) {
    if (round == 1) {
      for (std::size_t i = 0; i < count; i += few)
        sizes.push_back(float(points[i].offset - dot(rows[i], x)));
      fit.growth = median(sizes);
      sizes.clear();
      grown = std::abs(fit.growth) > kLeastGrowth;
      if (!grown) fit.growth = 0;
    }
    for (std::size_t i = 0; i < count; ++i)
      residual[i] = float((points[i].offset - fit.growth - dot(rows[i], x)) / points[i].noise);
    const auto scales = scales_of(points, residual, floor);
    Normal<N> n = prior;
    for (std::size_t i = 0; i < count; ++i) {
      const float scale = scales[std::size_t(points[i].kind)];
      fit.deviation[i] = scale * float(points[i].noise);
      const double q = residual[i] / (kTukey * scale);
      fit.used[i] = std::abs(q) < 1;
      weights[i] =
          fit.used[i] ? (1 - q * q) * (1 - q * q) / (fit.deviation[i] * fit.deviation[i]) : 0;
    }
    n.add_all(rows, weights, points);
    typename Normal<N>::Shift shift;
    if (grown) shift = n.without_shift(rows, weights, points);
    n.mirror();
    if (!solve_symmetric<N>(n.a, n.b, x) || !finite(x)) return std::nullopt;
    if (grown && shift.alone > 0) fit.growth = (shift.value - dot(shift.with, x)) / shift.alone;
  }
  information = prior;
  // A jerk is found anew each time; it does not move the points any further.
  std::array<double, N> kept = x;
  for (std::size_t k = kRowParameters; k < N; ++k) kept[k] = 0;
  double squares = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double step = dot(rows[i], kept);
    squares += step * step;
    fit.left[i] =
        float(points[i].offset - fit.growth - (N > kRowParameters ? dot(rows[i], x) : step));
    if (i % few == 0) sizes.push_back(std::abs(fit.left[i]));
    weights[i] = fit.used[i] ? 1 / (fit.deviation[i] * fit.deviation[i]) : 0;
  }
  information.add_all(rows, weights, points);
  if (grown) information.without_shift(rows, weights, points);
  information.mirror();
  fit.residual = median(sizes);
  fit.motion = std::sqrt(squares / double(count));
  return fit;
}

// How a point that a rolling shutter shows moves across its edge with the parameters of pose and
// motion. It has to be exact: the two are told apart by little.
//
// Seen s later, x = RX + t has become x' = T (x + z), T = exp([u]×), so that with du = s w' + …
//   dx' = T (w × RX + d) + (J du) × x' + T dz,   dz = s (d' - w' × t) + …,   J = 1 + [u]× / 2 + …
// A change in the picture moves the point into another row: with the flow f, in pixels a readout,
//   dp = dπ + f dp_y / h   gives   n·dp = (n + (n·f) / (h - f_y) e_y)·dπ.
std::optional<RowVector> rolling_row(const EdgePoint& p, const Lens& lens, const Pose& pose,
                                     const Rows& rows) {
  const double s = rows.later(p.pixel.y);
  const RowMotion& motion = rows.motion;
  const glm::dvec3 turned = pose.rotation * glm::dvec3(p.point, 0), &t = pose.translation;
  const glm::dvec3 later = motion.moved(turned + t, s),
                   u = s * (motion.turn + 0.5 * s * motion.turning);
  glm::dmat2x3 d;
  if (!lens.project(later, &d)) return std::nullopt;
  const glm::dvec3 speed = motion.speed(later, s);
  const glm::dvec2 flow(glm::dot(d[0], speed), glm::dot(d[1], speed));
  const double along = glm::dot(p.normal, flow) / (rows.height - flow.y);
  const glm::dvec3 g = p.normal.x * d[0] + (p.normal.y + along) * d[1],
                   back = slightly_turned(-u, g);
  const glm::dvec3 r = glm::cross(turned, back), a = glm::cross(later, g);
  const glm::dvec3 m = a - 0.5 * glm::cross(u, a) - glm::cross(t, back);
  RowVector out{r.x, r.y, r.z, back.x, back.y, back.z};
  for (int k = 0; k < 3; ++k) {
    out[std::size_t(6 + k)] = s * m[k], out[std::size_t(9 + k)] = s * back[k];
    out[std::size_t(12 + k)] = 0.5 * s * s * m[k], out[std::size_t(15 + k)] = 0.5 * s * s * back[k];
    out[std::size_t(18 + k)] = s * s * s / 6 * m[k];
    out[std::size_t(21 + k)] = s * s * s / 6 * back[k];
  }
  return out;
}

// What is expected, as far from `pose` and the motion of `rows` as they now are.
Normal<kRowUnknowns> expectation(const Pose& pose, const Rows& rows, const RowPrior& prior) {
  const glm::dvec3 turn = rotation_vector(prior.pose.rotation * glm::transpose(pose.rotation)),
                   shift = prior.pose.translation - pose.translation;
  const auto motion = difference(prior.motion, rows.motion, pose.translation);
  RowVector off{turn.x, turn.y, turn.z, shift.x, shift.y, shift.z};
  std::copy(motion.begin(), motion.end(), off.begin() + 6);
  Normal<kRowUnknowns> n;
  for (std::size_t i = 0; i < kRowParameters; ++i)
    for (std::size_t k = 0; k < kRowParameters; ++k) {
      n.a[kRowUnknowns * i + k] = prior.information[kRowParameters * i + k];
      n.b[i] += prior.information[kRowParameters * i + k] * off[k];
    }
  const auto jerk = steadiness(prior.jerk, pose.translation);
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k)
      n.a[kRowUnknowns * (kRowParameters + i) + kRowParameters + k] = jerk[6 * i + k];
  return n;
}

}  // namespace

UsedRange::UsedRange(std::span<const EdgePoint> points, const EdgeFit& fit) {
  for (std::size_t i = 0; i < points.size(); ++i)
    if (fit.used[i]) low = glm::min(low, points[i].point), high = glm::max(high, points[i].point);
}

std::optional<EdgeFit> fit_edges(std::span<const EdgePoint> points, const Lens& lens,
                                 const Pose& pose) {
  if (points.size() < kLeastPoints) return std::nullopt;
  std::vector<Row> rows;
  rows.reserve(points.size());
  for (const EdgePoint& p : points) {
    const auto row = row_of(p, lens, pose);
    if (!row) return std::nullopt;
    rows.push_back(*row);
  }
  Row x{};
  Normal<6> information;
  auto fit = fastibl::fit(points, rows, Normal<6>{}, x, information);
  if (!fit) return std::nullopt;
  fit->information = information.a;
  fit->camera_from_marker = moved(pose, x);
  return fit;
}

std::optional<EdgeFit> fit_edges(std::span<const EdgePoint> points, const Lens& lens,
                                 const Pose& pose, const Rows& rows, const RowPrior& prior) {
  if (points.size() < kLeastPoints) return std::nullopt;
  std::vector<RowVector> all;
  all.reserve(points.size());
  for (const EdgePoint& p : points) {
    const auto row = rolling_row(p, lens, pose, rows);
    if (!row) return std::nullopt;
    all.push_back(*row);
  }
  RowVector x{};
  Normal<kRowUnknowns> information;
  auto fit = fastibl::fit(points, all, expectation(pose, rows, prior), x, information);
  if (!fit) return std::nullopt;
  fit->camera_from_marker = moved(pose, {x[0], x[1], x[2], x[3], x[4], x[5]});
  fit->row_motion = changed(rows.motion, std::span(x).subspan<6, 12>(), pose.translation);
  fit->row_information = information.a;
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k)
      fit->information[6 * i + k] = information.a[kRowUnknowns * i + k];
  return fit;
}

std::optional<RowEvidence> row_evidence(std::span<const EdgePoint> points, const Lens& lens,
                                        const Pose& pose, const Rows& rows) {
  // A fit that may not move tells which points agree.
  RowPrior still{pose, rows.motion, {}, {1e-9, 1e-9}};
  for (std::size_t i = 0; i < kRowParameters; ++i)
    still.information[(kRowParameters + 1) * i] = 1e18;
  const auto fit = fit_edges(points, lens, pose, rows, still);
  if (!fit) return std::nullopt;
  Normal<kRowUnknowns> sums;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (fit->used[i])
      sums.add(*rolling_row(points[i], lens, pose, rows),
               1 / (fit->deviation[i] * fit->deviation[i]), points[i].offset);
  sums.mirror();
  return RowEvidence{sums.a, sums.b};
}

std::vector<EdgePoint> unrolled(std::span<const EdgePoint> points, const Lens& lens,
                                const Pose& pose, const Rows& rows) {
  std::vector<EdgePoint> out(points.begin(), points.end());
  for (EdgePoint& p : out) {
    const glm::dvec3 at = pose * glm::dvec3(p.point, 0);
    const auto still = lens.project(at);
    const auto rolled = rows.project(lens, at, rows.later(p.pixel.y));
    if (still && rolled) p.pixel += *still - rolled->pixel;
  }
  return out;
}

namespace {

// Distance of a found edge from where the pose puts it, in units of its deviation.
double distance(const EdgePoint& p, const EdgeFit& fit, std::size_t i, const glm::dvec2& pixel) {
  return (p.offset - fit.growth - glm::dot(p.normal, pixel - p.pixel)) / fit.deviation[i];
}

}  // namespace

double edge_cost(std::span<const EdgePoint> points, const EdgeFit& fit, const Lens& lens,
                 const Pose& pose) {
  double cost = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!fit.used[i]) continue;
    const auto pixel = lens.project(pose * glm::dvec3(points[i].point, 0));
    const double e = pixel ? distance(points[i], fit, i, *pixel) : 1e9;
    cost += std::min(e * e, kFarCost);
  }
  return cost;
}

std::optional<Pose> refit_edges(std::span<const EdgePoint> points, const EdgeFit& fit,
                                const Lens& lens, const Pose& start) {
  Pose pose = start;
  const auto cost_of = [&](const Pose& at) {  // not truncated: the start is far
    double cost = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!fit.used[i]) continue;
      const auto pixel = lens.project(at * glm::dvec3(points[i].point, 0));
      if (!pixel) return std::numeric_limits<double>::infinity();
      const double e = distance(points[i], fit, i, *pixel);
      cost += e * e;
    }
    return cost;
  };
  double cost = cost_of(pose), damping = 1e-4;
  if (!std::isfinite(cost)) return std::nullopt;
  for (int step = 0; step < 12 && damping < 1e6; ++step) {
    Normal<6> n;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!fit.used[i]) continue;
      glm::dvec2 pixel(0);
      Row row = *row_of(points[i], lens, pose, &pixel);
      const double scale = fit.deviation[i];
      for (double& v : row) v /= scale;
      n.add(row, 1, distance(points[i], fit, i, pixel));
    }
    n.mirror();
    for (std::size_t i = 0; i < 6; ++i) n.a[7 * i] *= 1 + damping;
    Row x{};
    if (!solve_symmetric<6>(n.a, n.b, x) || !finite(x)) return std::nullopt;
    const Pose next = moved(pose, x);
    const double value = cost_of(next);
    if (value < cost) {
      const bool small = cost - value < 1e-3 * cost;
      pose = next, cost = value, damping *= 0.1;
      if (small) break;
    } else {
      damping *= 10;
    }
  }
  return pose;
}

}  // namespace fastibl
