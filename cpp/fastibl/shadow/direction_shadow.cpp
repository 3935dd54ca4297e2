#include "fastibl/shadow/direction_shadow.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <numbers>
#include <optional>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

constexpr int kResolution = 128;  // of a map, by default
constexpr int kLeastOuter = 64;   // texels along an edge of the outer map, if the inner has as many
constexpr int kDirections = 16;   // of which a thread makes the bits together
constexpr double kUnseen = 1 / 510.0;  // half a step of an 8-bit picture
constexpr double kFarthest = 8;        // extent of the outer map, by that of the inner
constexpr int kSectors = 64;           // of the plane around the object
constexpr double kSectorAngle = 2 * std::numbers::pi / kSectors;
constexpr int kRows = 16;  // of a map, summed together: their differences stay in the L1 cache

using Share [[gnu::vector_size(16), gnu::may_alias]] = std::int32_t;
using Words [[gnu::vector_size(64), gnu::may_alias]] = std::uint64_t;

// Adds a share where the bits of eight rows begin to be set, and takes it off where they end. The
// cost is that of the edges: of an object a few in a row, whatever its size.
FASTIBL_CLONES
void add_edges(const std::uint64_t* words, std::ptrdiff_t column_stride, int columns,
               const glm::ivec4& whole, glm::ivec4* differences, std::ptrdiff_t row_stride) {
  const Share share = *reinterpret_cast<const Share*>(&whole);
  Words carry{};
  for (int c = 0; c < columns; ++c) {
    const Words bits = *reinterpret_cast<const Words*>(words + c * column_stride);
    const Words changes = bits ^ (bits << 1 | carry);
    std::uint64_t any = 0;
    for (int r = 0; r < 8; ++r) any |= changes[r];
    if (any != 0) {
      for (int r = 0; r < 8; ++r) {
        Share step = carry[r] ? -share : share;
        auto* row = reinterpret_cast<Share*>(differences + r * row_stride + 64 * c);
        for (std::uint64_t left = changes[r]; left != 0; left &= left - 1) {
          row[std::countr_zero(left)] += step;
          step = -step;
        }
      }
    }
    carry = bits >> 63;
  }
}

// Sums the differences of a row up to what is lost there.
FASTIBL_CLONES
void sum_row(const glm::ivec4* differences, int size, float* ratio) {
  constexpr float kScale = 1.0f / kWholeShare;
  Share lost{};
  for (int x = 0; x < size; ++x) {
    lost += reinterpret_cast<const Share*>(differences)[x];
    for (int c = 0; c < 3; ++c) ratio[3 * x + c] = 1 - float(lost[c]) * kScale;
  }
}

void sum_rows(std::span<const PlaneBits> bits, std::span<const glm::ivec4> shares, int begin,
              int end, Image<float>& ratio) {
  const int size = ratio.width, columns = (size + 63) / 64;
  const std::ptrdiff_t row_stride = 64 * columns;
  std::vector<glm::ivec4> differences(std::size_t(row_stride) * kRows, glm::ivec4(0));
  for (std::size_t k = 0; k < bits.size(); ++k) {
    const PlaneBits& b = bits[k];
    for (int y = begin; y < end; y += 8)
      add_edges(b.column(0) + y, b.padded_rows(), columns, shares[k],
                differences.data() + (y - begin) * row_stride, row_stride);
  }
  for (int y = begin; y < end; ++y)
    sum_row(differences.data() + (y - begin) * row_stride, size, ratio.row(y));
}

// A ball around all spheres that can cast a shadow; of radius 0 when there is none.
glm::dvec4 bounding_ball(const SphereSet& spheres) {
  glm::dvec3 lower(1e300), upper(-1e300);
  for (const glm::vec4& s : spheres)
    if (is_sphere(s) && double(s.z) + double(s.w) > 0) {
      lower = glm::min(lower, glm::dvec3(s) - double(s.w));
      upper = glm::max(upper, glm::dvec3(s) + double(s.w));
    }
  if (!(lower.x <= upper.x)) return glm::dvec4(0);
  const glm::dvec3 centre = 0.5 * (lower + upper);
  double radius = 0;
  for (const glm::vec4& s : spheres)
    if (is_sphere(s) && double(s.z) + double(s.w) > 0)
      radius = std::max(radius, glm::distance(glm::dvec3(s), centre) + double(s.w));
  return {centre, radius};
}

// How far out along x or y the shadow of a ball lies for each direction, the farthest first.
std::vector<std::pair<double, std::size_t>> reaches_of(std::span<const LightDirection> light,
                                                       const glm::dvec3& centre, double radius) {
  std::vector<std::pair<double, std::size_t>> reaches;
  for (std::size_t k = 0; k < light.size(); ++k) {
    const glm::dvec3 d(light[k].direction);
    const double x =
        std::fabs(centre.x - centre.z * d.x / d.z) + radius * std::hypot(d.x, d.z) / d.z;
    const double y =
        std::fabs(centre.y - centre.z * d.y / d.z) + radius * std::hypot(d.y, d.z) / d.z;
    reaches.emplace_back(std::max(x, y), k);
  }
  std::sort(reaches.begin(), reaches.end(), std::greater<>());
  return reaches;
}

void cast_bits(const PlaneSpheres& spheres, glm::vec3 direction, int size, PlaneBits& bits) {
  if (bits.size() == size)
    bits.clear();
  else
    bits = PlaneBits(size);
  spheres.add_shadow(direction, bits);
}

// Calls visit(x, y, keep) for the texels of the outer tenth, where less than all is kept.
template <typename Visit>
void for_border(int n, const Visit& visit) {
  const int width = std::min(int(0.05f * float(n)) + 2, n);
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      if (y >= width && y < n - width && x == width) x = std::max(x, n - width);
      const glm::vec2 p(shared::plane_offset(x, float(n)), shared::plane_offset(y, float(n)));
      visit(x, y, p, shared::shadow_keep(p, float(n)));
    }
}

// To exactly 1 at the border texels.
void fade_border(Image<float>& ratio) {
  for_border(ratio.width, [&](int x, int y, glm::vec2, float keep) {
    float* r = ratio.pixel(x, y);
    for (int c = 0; c < 3; ++c) r[c] = 1 + keep * (r[c] - 1);
  });
}

// To the outer map, so that no seam is seen between the two.
void join_border(ShadowMap& map) {
  if (map.outer.empty()) return;
  for_border(map.ratio.width, [&](int x, int y, glm::vec2 p, float keep) {
    const glm::vec3 outside = map.sample_outer(map.centre + map.extent * p);
    float* r = map.ratio.pixel(x, y);
    for (int c = 0; c < 3; ++c) r[c] = outside[c] + keep * (r[c] - outside[c]);
  });
}

}  // namespace

Image<float> ratio_of(std::span<const PlaneBits> bits, std::span<const glm::ivec4> shares) {
  check(!bits.empty() && bits.size() == shares.size(), "there must be as many shares as bits");
  const int size = bits[0].size();
  for (const PlaneBits& b : bits) check(b.size() == size, "the bits must be of one size");
  Image<float> ratio(size, size, 3);
  parallel_for(size, kRows, [&](int begin, int end) { sum_rows(bits, shares, begin, end, ratio); });
  return ratio;
}

float outer_extent(std::span<const LightDirection> light, const SphereSet& spheres,
                   const PlaneGrid& grid) {
  const glm::dvec4 ball = bounding_ball(spheres);
  if (!(ball.w > 0)) return 0;
  const glm::dvec3 centre = glm::dvec3(ball) - glm::dvec3(glm::dvec2(grid.centre), 0);
  const auto reaches = reaches_of(light, centre, ball.w);
  // From the farthest inwards, until what reaches that far in one sector of the plane can be seen.
  std::array<glm::dvec3, kSectors> lost{};
  const double inner = grid.extent;
  for (const auto& [reach, k] : reaches) {
    if (reach <= inner) return 0;
    const glm::dvec3 d(light[k].direction);
    // The ellipse lies along the line from below the ball away from the light; seen from the grid's
    // centre it is no wider than the ball at the nearest distance that counts.
    const double off = glm::length(glm::dvec2(centre)) + ball.w;
    const double half = std::asin(std::min(off / inner, 1.0)) + 0.5 * kSectorAngle;
    const double middle = std::atan2(-d.y, -d.x);
    const int first = int(std::floor((middle - half) / kSectorAngle)),
              last = int(std::floor((middle + half) / kSectorAngle));
    for (int i = first; i <= std::min(last, first + kSectors - 1); ++i) {
      glm::dvec3& sum = lost[std::size_t(((i % kSectors) + kSectors) % kSectors)];
      sum += glm::dvec3(light[k].share);
      if (std::max(std::max(sum.x, sum.y), sum.z) > kUnseen)
        return float(std::min(reach, kFarthest * inner));
    }
  }
  return 0;
}

void DirectionShadow::place(const SphereSet& spheres, const ShadowOptions& options) {
  spheres_ = spheres;
  options_ = options;
  place_map(spheres, options, map_);
  inner_ = {options.resolution > 0 ? options.resolution : kResolution, map_.centre, map_.extent};
}

void DirectionShadow::make_bits() {
  const std::vector<LightDirection>& light = light_.directions();
  outer_ = {std::max(inner_.size / 2, std::min(inner_.size, kLeastOuter)), inner_.centre, 0};
  if (options_.outer) outer_.extent = outer_extent(light, spheres_, inner_);
  const PlaneSpheres inner(spheres_, inner_);
  map_.ignored_spheres = inner.ignored();
  inner_bits_.resize(light.size());
  outer_bits_.resize(outer_.extent > 0 ? light.size() : 0);
  std::optional<PlaneSpheres> outer;
  glm::dvec4 ball(0);
  if (outer_.extent > 0) outer.emplace(spheres_, outer_), ball = bounding_ball(spheres_);
  parallel_for(int(light.size()), kDirections, [&](int begin, int end) {
    for (int k = begin; k < end; ++k) {
      const glm::vec3 d = light[std::size_t(k)].direction;
      cast_bits(inner, d, inner_.size, inner_bits_[std::size_t(k)]);
      if (outer) cast_bits(*outer, d, outer_.size, outer_bits_[std::size_t(k)]);
    }
  });
}

void DirectionShadow::make_ratio() {
  const std::vector<glm::ivec4> shares = whole_shares(light_.directions());
  map_.ratio = ratio_of(inner_bits_, shares);
  map_.outer = {};
  map_.outer_extent = 0;
  if (outer_.extent > 0) {
    map_.outer = ratio_of(outer_bits_, shares);
    map_.outer_extent = outer_.extent;
    fade_border(map_.outer);
  }
  if (options_.outer)
    join_border(map_);
  else
    fade_border(map_.ratio);
}

const ShadowMap& DirectionShadow::cast(const CubeMap& radiance, const SphereSet& spheres,
                                       const ShadowOptions& options) {
  check_options(options);
  const SteadyLight::Change change = light_.update(radiance);
  const bool moved = map_.ratio.empty() || spheres != spheres_ || options != options_;
  if (change == SteadyLight::Change::none && !moved) return map_;
  if (moved) place(spheres, options);
  map_.no_light = light_.no_light();
  if (map_.no_light) {
    map_.ratio = Image<float>(inner_.size, inner_.size, 3, 1.0f);
    map_.outer = {};
    map_.outer_extent = 0;
    map_.ignored_spheres = PlaneSpheres(spheres, inner_).ignored();
    inner_bits_.clear();
    return map_;
  }
  if (moved || change == SteadyLight::Change::directions || inner_bits_.empty()) make_bits();
  make_ratio();
  return map_;
}

}  // namespace fastibl
