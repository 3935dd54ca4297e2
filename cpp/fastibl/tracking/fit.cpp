#include "fastibl/tracking/fit.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace fastibl {
namespace {

constexpr int kMostSteps = 60;
constexpr double kUnseen = 1e4;  // px; error of a point that the lens does not show

struct Normal {
  std::array<double, 36> a{};
  std::array<double, 6> b{};
  double cost = 0;
  int seen = 0;
};

Normal normal_equations(std::span<const Match> matches, const Lens& lens, const Pose& pose,
                        const Loss& loss) {
  Normal n;
  for (const Match& match : matches) {
    const glm::dvec3 turned = pose.rotation * glm::dvec3(match.point, 0);
    glm::dmat2x3 d;
    const auto pixel = lens.project(turned + pose.translation, &d);
    if (!pixel) {
      n.cost += loss.cost(kUnseen);
      continue;
    }
    ++n.seen;
    const glm::dvec2 error = (*pixel - match.pixel) / match.noise;
    const double size = glm::length(error), weight = loss.weight(size);
    n.cost += loss.cost(size);
    if (weight == 0) continue;
    for (int row = 0; row < 2; ++row) {
      // d(exp([w]×) y)/dw at 0 is −[y]×, so gᵀ of it is y × g.
      const glm::dvec3 g = d[row] / match.noise, r = glm::cross(turned, g);
      const double j[6] = {r.x, r.y, r.z, g.x, g.y, g.z};
      for (std::size_t i = 0; i < 6; ++i) {
        n.b[i] -= weight * j[i] * error[row];
        for (std::size_t k = 0; k < 6; ++k) n.a[6 * i + k] += weight * j[i] * j[k];
      }
    }
  }
  return n;
}

bool finite(const Pose& pose) {
  double sum = 0;
  for (int i = 0; i < 3; ++i)
    sum += std::abs(pose.translation[i]) + glm::dot(pose.rotation[i], pose.rotation[i]);
  return std::isfinite(sum);
}

}  // namespace

double Loss::cost(double e) const {
  if (kind == Kind::huber) return e <= scale ? e * e : scale * (2 * e - scale);
  const double q = 1 - (e / scale) * (e / scale);
  return scale * scale / 3 * (e < scale ? 1 - q * q * q : 1);
}

double Loss::weight(double e) const {
  if (kind == Kind::huber) return e <= scale ? 1 : scale / e;
  const double q = 1 - (e / scale) * (e / scale);
  return e < scale ? q * q : 0;
}

double error_of(const Match& match, const Lens& lens, const Pose& pose) {
  const auto pixel = lens.project(pose * glm::dvec3(match.point, 0));
  return pixel ? glm::length(*pixel - match.pixel) / match.noise
               : std::numeric_limits<double>::infinity();
}

std::optional<PoseFit> fit_pose(std::span<const Match> matches, const Lens& lens, const Pose& start,
                                const Loss& loss) {
  Pose pose = start;
  Normal n = normal_equations(matches, lens, pose, loss);
  if (n.seen < 4 || !std::isfinite(n.cost)) return std::nullopt;
  double damping = 1e-4;
  for (int step = 0; step < kMostSteps && damping < 1e12; ++step) {
    std::array<double, 36> a = n.a;
    for (std::size_t i = 0; i < 6; ++i) a[7 * i] *= 1 + damping;
    std::array<double, 6> x{};
    if (!solve_symmetric<6>(a, n.b, x)) {
      damping = damping * 10 + 1e-9;
      continue;
    }
    const glm::dvec3 turn(x[0], x[1], x[2]), shift(x[3], x[4], x[5]);
    const Pose next{orthonormal(rotation_from_vector(turn) * pose.rotation),
                    pose.translation + shift};
    const Normal m = normal_equations(matches, lens, next, loss);
    const bool small =
        glm::length(turn) < 1e-12 && glm::length(shift) < 1e-12 * glm::length(pose.translation);
    if (m.cost <= n.cost) {
      pose = next, n = m;
      damping = std::max(damping * 0.1, 1e-12);
    } else {
      damping *= 10;
    }
    if (small) break;
  }
  if (!finite(pose) || n.seen < 4) return std::nullopt;
  return PoseFit{pose, n.cost, n.a};
}

std::optional<Pose> pose_from_homography(std::span<const Match> matches, const Lens& lens) {
  // Points are moved to their centre and to unit size, or the normal equations lose their digits.
  glm::dvec2 centre(0), seen_centre(0);
  std::vector<glm::dvec2> seen;
  seen.reserve(matches.size());
  for (const Match& match : matches) {
    const auto ray = lens.unproject(match.pixel);
    if (!ray) return std::nullopt;
    seen.push_back(glm::dvec2(*ray));
    centre += match.point, seen_centre += seen.back();
  }
  if (matches.size() < 4) return std::nullopt;
  centre /= double(matches.size()), seen_centre /= double(matches.size());
  double size = 0, seen_size = 0;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    size += glm::length(matches[i].point - centre);
    seen_size += glm::length(seen[i] - seen_centre);
  }
  size /= double(matches.size()), seen_size /= double(matches.size());
  if (!(size > 0) || !(seen_size > 0)) return std::nullopt;

  // Direct linear transform with H[2][2] = 1: the centre of the points is in front of the camera.
  double a[8][9] = {};
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const glm::dvec2 p = (matches[i].point - centre) / size,
                     q = (seen[i] - seen_centre) / seen_size;
    const double rows[2][9] = {{p.x, p.y, 1, 0, 0, 0, -q.x * p.x, -q.x * p.y, q.x},
                               {0, 0, 0, p.x, p.y, 1, -q.y * p.x, -q.y * p.y, q.y}};
    for (const auto& row : rows)
      for (int r = 0; r < 8; ++r)
        for (int c = 0; c < 9; ++c) a[r][c] += row[r] * row[c];
  }
  for (int k = 0; k < 8; ++k) {  // Gauss–Jordan with pivoting
    int pivot = k;
    for (int r = k + 1; r < 8; ++r)
      if (std::abs(a[r][k]) > std::abs(a[pivot][k])) pivot = r;
    std::swap(a[k], a[pivot]);
    for (int r = 0; r < 8; ++r) {
      if (r == k) continue;
      const double f = a[r][k] / a[k][k];
      for (int c = k; c < 9; ++c) a[r][c] -= f * a[k][c];
    }
  }
  double h[8];
  for (int k = 0; k < 8; ++k) h[k] = a[k][8] / a[k][k];

  // Columns of λ [r1 r2 t]; t belongs to the points' centre.
  const auto column = [&](double u, double v, double w) {
    return glm::dvec3(seen_size * u + seen_centre.x * w, seen_size * v + seen_centre.y * w, w);
  };
  const glm::dvec3 h1 = column(h[0], h[3], h[6]) / size, h2 = column(h[1], h[4], h[7]) / size,
                   h3 = column(h[2], h[5], 1);
  const double scale = std::sqrt(glm::length(h1) * glm::length(h2));
  if (!(scale > 1e-12) || !std::isfinite(scale)) return std::nullopt;
  // The pair of orthogonal unit vectors nearest to both columns alike.
  const glm::dvec3 u = glm::normalize(h1), v = glm::normalize(h2);
  const glm::dvec3 sum = glm::normalize(u + v), difference = glm::normalize(u - v);
  const double half = std::sqrt(0.5);
  const glm::dvec3 r1 = half * (sum + difference), r2 = half * (sum - difference);
  Pose pose{glm::dmat3(r1, r2, glm::cross(r1, r2)), h3 / scale};
  pose.translation -= pose.rotation * glm::dvec3(centre, 0);
  if (!finite(pose)) return std::nullopt;  // points on a line, or all in one place
  return pose;
}

Pose mirrored_pose(const Pose& pose, const glm::dvec2& centre) {
  // With v the viewing direction and n the normal, n' = 2 (n·v) v − n. In the frame of v this keeps
  // the upper left 2 × 2 block of R, which is all that weak perspective sees:
  // R' = (1 − 2 v vᵀ) R diag(1, 1, −1).
  const glm::dvec3 at = pose * glm::dvec3(centre, 0), v = glm::normalize(at);
  const auto flip = [&](const glm::dvec3& x) { return x - 2 * glm::dot(v, x) * v; };
  Pose other;
  other.rotation =
      glm::dmat3(flip(pose.rotation[0]), flip(pose.rotation[1]), -flip(pose.rotation[2]));
  other.translation = at - other.rotation * glm::dvec3(centre, 0);
  return other;
}

}  // namespace fastibl
