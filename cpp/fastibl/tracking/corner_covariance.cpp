#include "fastibl/tracking/corner_covariance.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/solve.h"

namespace fastibl {
namespace {

// Errors of measured sides by what their scatter tells: 1.2 to 2 in films, 1 to 2.7 in photographs.
constexpr double kSideScatter = 1.6;
// px, what lens, print and ink do to a tag, which none of its sides tells; 0.03 to 0.1 in
// photographs. All of it is shifted in x and in y, and its sides lie out or in, all alike or one by
// one.
constexpr double kShifted = 0.07, kGrown = 0.07, kSideGrown = 0.03;
constexpr double kUneven = 0.25;  // of the lift's variance, which differs by side
// The residuals of fewer tags are too few: with 2 or 10 degrees of freedom, they count beside the
// word of the sides, which has about as many.
constexpr std::size_t kEnough = 3;
constexpr double kFreedom = 16;
constexpr double kLeast = 3e-3;  // px: residuals of exact pictures

using Corners = std::array<double, 8>;  // x and y of each

// How the corners move when sides move outwards by `at_start` and `at_end`, four numbers each.
struct SideMotion {
  std::array<glm::dvec2, 4> normal;  // outwards
  std::array<glm::dmat2, 4> inverse;

  explicit SideMotion(const std::array<Match, 4>& matches) {
    for (std::size_t i = 0; i < 4; ++i) {
      const glm::dvec2 d = glm::normalize(matches[(i + 1) % 4].pixel - matches[i].pixel);
      normal[i] = {d.y, -d.x};
    }
    // A corner lies on the side before, at its end, and on its own, at its start.
    for (std::size_t i = 0; i < 4; ++i)
      inverse[i] = glm::inverse(glm::transpose(glm::dmat2(normal[(i + 3) % 4], normal[i])));
  }
  Corners operator()(const std::array<double, 4>& at_start,
                     const std::array<double, 4>& at_end) const {
    Corners out;
    for (std::size_t i = 0; i < 4; ++i) {
      const glm::dvec2 moved = inverse[i] * glm::dvec2(at_end[(i + 3) % 4], at_start[i]);
      out[2 * i] = moved.x, out[2 * i + 1] = moved.y;
    }
    return out;
  }
};

using Motion = std::array<double, 6>;

// Normal equations of a tag: how its corners' errors move the sum JᵀWe, and its errors.
struct TagEquations {
  std::array<Motion, 8> by_error{};
  Corners error{};
  bool seen = true;

  TagEquations(const CornersOfTag& tag, const Lens& lens, const Pose& pose) {
    for (std::size_t k = 0; k < 4; ++k) {
      const Match& match = tag.matches[k];
      const glm::dvec3 turned = pose.rotation * glm::dvec3(match.point, 0);
      glm::dmat2x3 d;
      const auto pixel = lens.project(turned + pose.translation, &d);
      if (!pixel) {
        seen = false;
        return;
      }
      const double weight = 1 / (match.noise * match.noise);
      for (int row = 0; row < 2; ++row) {
        const glm::dvec3 g = weight * d[row], r = glm::cross(turned, g);
        const std::size_t i = 2 * k + std::size_t(row);
        by_error[i] = {r.x, r.y, r.z, g.x, g.y, g.z};
        error[i] = (*pixel - match.pixel)[row];
      }
    }
  }
  Motion sum(const Corners& errors) const {
    Motion out{};
    for (std::size_t i = 0; i < 8; ++i)
      for (std::size_t k = 0; k < 6; ++k) out[k] += errors[i] * by_error[i][k];
    return out;
  }
};

void add(const Motion& m, double variance, std::array<double, 36>& sums) {
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k) sums[6 * i + k] += variance * m[i] * m[k];
}

// Covariance of JᵀWe by what is known of the tag's corners before they are compared with a pose.
void add_expected(const CornersOfTag& tag, const TagEquations& equations, double noise,
                  std::array<double, 36>& sums) {
  if (!tag.sides) {
    for (std::size_t i = 0; i < 8; ++i)
      add(equations.by_error[i], std::pow(noise * tag.matches[i / 2].noise, 2), sums);
    return;
  }
  const SideMotion motion(tag.matches);
  const double lift = tag.sides->lift * tag.sides->lift;
  const double scatter = std::pow(kSideScatter * tag.sides->scatter, 2) + kUneven * lift;
  for (std::size_t i = 0; i < 4; ++i) {
    std::array<double, 4> out{}, back{};
    out[i] = 1, back[i] = -1;
    add(equations.sum(motion(out, out)), scatter + kSideGrown * kSideGrown, sums);
    add(equations.sum(motion(back, out)), 3 * scatter, sums);  // points spread evenly along a side
  }
  const std::array<double, 4> all{1, 1, 1, 1};
  add(equations.sum(motion(all, all)), lift + kGrown * kGrown, sums);
  for (std::size_t axis = 0; axis < 2; ++axis) {
    Corners shift{};
    for (std::size_t i = axis; i < 8; i += 2) shift[i] = 1;
    add(equations.sum(shift), kShifted * kShifted, sums);
  }
}

// Covariance of the pose from that of JᵀWe: A⁻¹ S A⁻¹.
std::array<double, 36> on_both_sides(const std::array<double, 36>& inverse,
                                     const std::array<double, 36>& sums) {
  std::array<double, 36> half{}, out{};
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k < 6; ++k)
      for (std::size_t j = 0; j < 6; ++j) half[6 * i + k] += inverse[6 * i + j] * sums[6 * j + k];
  for (std::size_t i = 0; i < 6; ++i)
    for (std::size_t k = 0; k <= i; ++k) {
      for (std::size_t j = 0; j < 6; ++j) out[6 * i + k] += half[6 * i + j] * inverse[6 * j + k];
      out[6 * k + i] = out[6 * i + k];
    }
  return out;
}

}  // namespace

std::optional<std::array<double, 36>> corner_covariance(std::span<const CornersOfTag> tags,
                                                        const Lens& lens, const PoseFit& fit,
                                                        double noise) {
  std::array<double, 36> inverse{}, sums{};
  if (!invert<6>(fit.information, inverse)) return std::nullopt;
  const bool measured = std::any_of(tags.begin(), tags.end(),
                                    [](const CornersOfTag& tag) { return tag.sides.has_value(); });
  double shifts = 0;  // squares of the tags' own, in units of their noise
  for (const CornersOfTag& tag : tags) {
    const TagEquations equations(tag, lens, fit.camera_from_marker);
    if (!equations.seen) continue;
    if (tags.size() < kEnough) add_expected(tag, equations, noise, sums);
    glm::dvec2 shift(0);
    for (std::size_t i = 0; i < 4; ++i)
      shift += glm::dvec2(equations.error[2 * i], equations.error[2 * i + 1]) /
               (4 * tag.matches[i].noise);
    shifts += glm::dot(shift, shift);
  }
  // What the residuals tell: of each corner, or, where a tag's corners err together, of each tag.
  const double count = double(tags.size()), freedom = std::max(2.0, 8 * count - 6);
  double variance = std::max(fit.cost / freedom, 4 * shifts / (2 * count - std::min(6.0, count)));
  variance = std::max(variance, std::pow(measured ? kLeast : noise, 2));
  const double share = tags.size() < kEnough ? kFreedom / (kFreedom + freedom) : 0;
  std::array<double, 36> covariance = on_both_sides(inverse, sums);
  double all = 0;
  for (std::size_t k = 0; k < 36; ++k) {
    covariance[k] = share * covariance[k] + (1 - share) * variance * inverse[k];
    all += covariance[k];
  }
  if (!std::isfinite(all)) return std::nullopt;
  return covariance;
}

}  // namespace fastibl
