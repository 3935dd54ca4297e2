#include "fastibl/shadow/direction_shadow.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/core/sole_owner.h"
#include "fastibl/shadow/map_border.h"
#include "fastibl/shadow/near_spheres.h"
#include "fastibl/shadow/plane_rows.h"

namespace fastibl {
namespace {

constexpr int kResolution = 128;  // of a map, by default
constexpr int kLeastOuter = 64;   // texels along an edge of the outer map, if the inner has as many
constexpr int kDirections = 16;   // whose bits a thread makes together
constexpr double kUnseen = 1 / 510.0;  // half a step of an 8-bit picture
constexpr double kMostExtent = std::numeric_limits<float>::max();
constexpr int kSectors = 64;  // of the plane around the object
constexpr double kSectorAngle = 2 * std::numbers::pi / kSectors;
constexpr int kRows = 8;    // of a map, summed together: a vector of words
constexpr int kStrip = 16;  // rows of a thread

using Share [[gnu::vector_size(16), gnu::may_alias]] = std::int32_t;
using Words [[gnu::vector_size(64), gnu::may_alias]] = std::uint64_t;

// What one direction hides of eight rows.
struct alignas(64) StripBits {
  Words carry;  // the last bit of the column before
  Share share;
  const std::uint64_t* words;  // of column 0, in the first of the rows
  int first_column, last_column;
};
constexpr std::size_t kAhead = 8;  // directions whose bits are fetched meanwhile

// Texels of a word of eight rows: 8 KiB, so that all directions find them in the nearest cache.
struct alignas(64) WordTexels {
  glm::ivec4 row[kRows][64];
};

// Adds a share where set bits of a word of eight rows begin, and takes it off where they end. The
// cost depends on the edges alone: an object has a few in a row, whatever its size. False if no
// direction has an edge here. Columns must come in order; `strip` has kAhead more at its end.
FASTIBL_CLONES
bool add_edges(StripBits* strip, std::size_t count, int column, std::ptrdiff_t column_stride,
               WordTexels& differences) {
  bool changed = false;
  for (std::size_t k = 0; k < count; ++k) {
    StripBits& s = strip[k];
    __builtin_prefetch(strip[k + kAhead].words + column * column_stride);
    if (column < s.first_column || column > s.last_column + 1) continue;
    const std::uint64_t* words = s.words + column * column_stride;
    const Words bits = *reinterpret_cast<const Words*>(words);
    const Words carry = s.carry;
    const Words changes = bits ^ (bits << 1 | carry);
    s.carry = bits >> 63;
    std::uint64_t any = 0;
    for (int r = 0; r < kRows; ++r) any |= changes[r];
    if (any == 0) continue;
    changed = true;
    for (int r = 0; r < kRows; ++r) {
      Share step = carry[r] ? -s.share : s.share;
      auto* row = reinterpret_cast<Share*>(differences.row[r]);
      for (std::uint64_t left = changes[r]; left != 0; left &= left - 1) {
        row[std::countr_zero(left)] += step;
        step = -step;
      }
    }
  }
  return changed;
}

constexpr float kShareUnit = 1.0f / kWholeShare;

using Four [[gnu::vector_size(64), gnu::may_alias]] = std::int32_t;  // texels
using Colours [[gnu::vector_size(64)]] = float;
using Stored [[gnu::vector_size(64), gnu::aligned(4), gnu::may_alias]] = float;

// Stores three of the four channels of 16 texels.
FASTIBL_INLINE void store_texels(const Colours& a, const Colours& b, const Colours& c,
                                 const Colours& d, float* ratio) {
  *reinterpret_cast<Stored*>(ratio) =
      __builtin_shufflevector(a, b, 0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 16, 17, 18, 20);
  *reinterpret_cast<Stored*>(ratio + 16) =
      __builtin_shufflevector(b, c, 5, 6, 8, 9, 10, 12, 13, 14, 16, 17, 18, 20, 21, 22, 24, 25);
  *reinterpret_cast<Stored*>(ratio + 32) =
      __builtin_shufflevector(c, d, 10, 12, 13, 14, 16, 17, 18, 20, 21, 22, 24, 25, 26, 28, 29, 30);
}

FASTIBL_INLINE void repeat_texel(const glm::ivec4& texel, Four& four) {
  const Share t = *reinterpret_cast<const Share*>(&texel);
  four = __builtin_shufflevector(t, t, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3);
}

// Writes the light that is left to 64 texels of one colour.
FASTIBL_CLONES
void fill_texels(const glm::ivec4& lost, float* ratio) {
  Four four;
  repeat_texel(lost, four);
  const Colours left = 1 - __builtin_convertvector(four, Colours) * kShareUnit;
  for (int x = 0; x < 64; x += 16, ratio += 48) store_texels(left, left, left, left, ratio);
}

// Sums the differences of 64 texels to the light that is lost there, and clears them.
FASTIBL_CLONES
void sum_texels(glm::ivec4* differences, glm::ivec4& lost_before, float* ratio) {
  Four lost;
  repeat_texel(lost_before, lost);
  const Four none{};
  auto* difference = reinterpret_cast<Four*>(differences);
  for (int x = 0; x < 4; ++x, ratio += 48) {
    Colours left[4];
    for (int i = 0; i < 4; ++i, ++difference) {
      // Four at a time: each sum includes all before it.
      Four sum = *difference;
      *difference = none;
      sum += __builtin_shufflevector(none, sum, 0, 1, 2, 3, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25,
                                     26, 27);
      sum += __builtin_shufflevector(none, sum, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22,
                                     23);
      left[i] = 1 - __builtin_convertvector(sum + lost, Colours) * kShareUnit;
      lost += __builtin_shufflevector(sum, sum, 12, 13, 14, 15, 12, 13, 14, 15, 12, 13, 14, 15, 12,
                                      13, 14, 15);
    }
    store_texels(left[0], left[1], left[2], left[3], ratio);
  }
  const Share last = __builtin_shufflevector(lost, lost, 0, 1, 2, 3);
  *reinterpret_cast<Share*>(&lost_before) = last;
}

// Sums eight rows, word by word. A word is summed when the edges of the next one have been added:
// by then its own edges are no longer on their way to memory.
void sum_strip(std::span<StripBits> strip, std::ptrdiff_t column_stride, int first, int rows,
               std::array<WordTexels, 2>& differences, Image<float>& ratio) {
  const int size = ratio.width, columns = (size + 63) / 64;
  alignas(64) glm::ivec4 lost[kRows] = {};
  bool changed = false;
  for (int column = 0; column <= columns; ++column) {
    const bool next_changed =
        column < columns && add_edges(strip.data(), strip.size() - kAhead, column, column_stride,
                                      differences[std::size_t(column % 2)]);
    if (column > 0) {
      const int begin = 64 * (column - 1), count = std::min(64, size - begin);
      WordTexels& word = differences[std::size_t((column - 1) % 2)];
      for (int r = 0; r < rows; ++r) {
        float part[3 * 64];  // of a word that the map ends in
        float* row = ratio.pixel(begin, first + r);
        float* out = count == 64 ? row : part;
        if (changed)
          sum_texels(word.row[r], lost[r], out);
        else
          fill_texels(lost[r], out);
        if (out == part) std::copy_n(part, 3 * count, row);
      }
    }
    changed = next_changed;
  }
}

void sum_rows(std::span<const PlaneBits> bits, std::span<const glm::ivec4> shares, int begin,
              int end, const BorderFade* fade, Image<float>& ratio) {
  auto differences = std::make_unique<std::array<WordTexels, 2>>();  // cleared by sum_texels()
  std::vector<StripBits> strip;
  for (int first = begin; first < end; first += kRows) {
    strip.clear();
    for (std::size_t k = 0; k < bits.size(); ++k) {
      const PlaneBits::Box& box = bits[k].box();
      if (first + kRows <= box.first_row || first > box.last_row) continue;
      const Share share = {shares[k].x, shares[k].y, shares[k].z, 0};
      strip.push_back(StripBits{.carry = Words{},
                                .share = share,
                                .words = bits[k].column(0) + first,
                                .first_column = box.first_column,
                                .last_column = box.last_column});
    }
    strip.resize(strip.size() + kAhead, StripBits{Words{}, Share{}, bits[0].column(0), 0, 0});
    const int rows = std::min(kRows, end - first);
    sum_strip(strip, bits[0].padded_rows(), first, rows, *differences, ratio);
    for (int y = first; fade && y < first + rows; ++y) fade->row(y, ratio.row(y));
  }
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
std::vector<std::pair<double, std::size_t>> reaches_of(std::span<const PlaneProjection> light,
                                                       const glm::dvec3& centre, double radius) {
  std::vector<std::pair<double, std::size_t>> reaches;
  for (std::size_t k = 0; k < light.size(); ++k) {
    const glm::dvec2 slope(light[k].slope);
    const double x = std::fabs(centre.x - centre.z * slope.x) + radius * std::hypot(slope.x, 1.0);
    const double y = std::fabs(centre.y - centre.z * slope.y) + radius * std::hypot(slope.y, 1.0);
    const double left = 1 - (centre.z + radius) * double(light[k].inverse_height);
    reaches.emplace_back(std::max(x, y) / std::max(left, 1e-3), k);
  }
  std::sort(reaches.begin(), reaches.end(), std::greater<>());
  return reaches;
}

void clear(int size, PlaneBits& bits) {
  if (bits.size() == size)
    bits.clear();
  else
    bits = PlaneBits(size);
}

void cast_bits(const PlaneSpheres& spheres, glm::vec3 direction, int size, PlaneBits& bits) {
  clear(size, bits);
  spheres.add_shadow(direction, bits);
}

void cast_near_bits(const SphereSet& spheres, const glm::dvec3& light, const PlaneGrid& grid,
                    PlaneBits& bits) {
  clear(grid.size, bits);
  add_near_shadow(spheres, light, grid, bits);
}

// Joins the border to the outer map, so that no seam is seen between the two.
void join_border(ShadowMap& map) {
  if (map.outer.empty()) return;
  const int n = map.ratio.width;
  const PlaneGrid grid{n, map.centre, map.extent};
  const std::vector<float> keep = border_keep(n);
  std::vector<glm::vec2> points(static_cast<std::size_t>(n));
  std::vector<glm::vec3> around(points.size());
  for_border(keep, [&](int begin, int end, int y) {
    const std::span row = std::span(points).first(std::size_t(end - begin));
    grid.points(begin, y, row);
    map.sample_outer(row, around);
    for (int x = begin; x < end; ++x) {
      const float k = std::min(keep[std::size_t(x)], keep[std::size_t(y)]);
      float* r = map.ratio.pixel(x, y);
      const glm::vec3& o = around[std::size_t(x - begin)];
      for (int c = 0; c < 3; ++c) r[c] = o[c] + k * (r[c] - o[c]);
    }
  });
}

}  // namespace

void sum_shares(std::span<const PlaneBits> bits, std::span<const glm::ivec4> shares,
                Image<float>& ratio, bool fading) {
  check(!bits.empty() && bits.size() == shares.size(), "there must be as many shares as bits");
  const int size = bits[0].size();
  for (const PlaneBits& b : bits) check(b.size() == size, "the bits must be of one size");
  if (ratio.width != size || ratio.height != size || ratio.channels != 3)
    ratio = Image<float>(size, size, 3);
  std::optional<BorderFade> fade;
  if (fading) fade.emplace(size);
  parallel_for(size, kStrip, [&](int begin, int end) {
    sum_rows(bits, shares, begin, end, fade ? &*fade : nullptr, ratio);
  });
}

float outer_extent(std::span<const LightDirection> light, const SphereSet& spheres,
                   const PlaneGrid& grid, const NearPlane& near_plane) {
  const glm::dvec4 ball = bounding_ball(spheres);
  if (!(ball.w > 0)) return 0;
  const glm::dvec3 centre = glm::dvec3(ball) - glm::dvec3(glm::dvec2(grid.centre), 0);
  std::vector<PlaneProjection> projections;
  for (const LightDirection& l : light) {
    const int i = near_plane.light_of(l.direction);
    projections.push_back(i < 0 ? along(l.direction)
                                : near_plane.projection(l.direction, i, grid.centre));
  }
  const auto reaches = reaches_of(projections, centre, ball.w);
  // From the farthest inwards, until what reaches that far in one sector of the plane can be seen.
  std::array<glm::dvec3, kSectors> lost{};
  const double inner = grid.extent;
  for (const auto& [reach, k] : reaches) {
    if (reach <= inner) return 0;
    const glm::dvec2 slope(projections[k].slope);
    // The ellipse lies along the line from below the ball away from the light; seen from the grid's
    // centre it is no wider than the ball at the nearest distance that counts.
    const double off = glm::length(glm::dvec2(centre)) + ball.w;
    const double half = std::asin(std::min(off / inner, 1.0)) + 0.5 * kSectorAngle;
    const double middle = std::atan2(-slope.y, -slope.x);
    const int first = int(std::floor((middle - half) / kSectorAngle)),
              last = int(std::floor((middle + half) / kSectorAngle));
    for (int i = first; i <= std::min(last, first + kSectors - 1); ++i) {
      glm::dvec3& sum = lost[std::size_t(((i % kSectors) + kSectors) % kSectors)];
      sum += glm::dvec3(light[k].share);
      if (std::max(std::max(sum.x, sum.y), sum.z) > kUnseen)
        return float(std::min({reach, kMostOuter * inner, kMostExtent}));
    }
  }
  return 0;
}

void DirectionShadow::place(const SphereSet& spheres, const ShadowOptions& options) {
  spheres_ = spheres;
  options_ = options;
  place_map(spheres, options, *map_);
  inner_ = {options.resolution > 0 ? options.resolution : kResolution, map_->centre, map_->extent};
}

void DirectionShadow::make_bits() {
  const std::vector<LightDirection>& light = light_.directions();
  outer_ = {std::max(inner_.size / 2, std::min(inner_.size, kLeastOuter)), inner_.centre, 0};
  if (options_.outer) outer_.extent = outer_extent(light, spheres_, inner_, near_);
  const PlaneSpheres inner(spheres_, inner_);
  map_->ignored_spheres = inner.ignored();
  inner_bits_.resize(light.size());
  outer_bits_.resize(outer_.extent > 0 ? light.size() : 0);
  std::optional<PlaneSpheres> outer;
  if (outer_.extent > 0) outer.emplace(spheres_, outer_);
  parallel_for(int(light.size()), kDirections, [&](int begin, int end) {
    ShadowTriangles::Scratch scratch;
    for (int k = begin; k < end; ++k) {
      const glm::vec3 d = light[std::size_t(k)].direction;
      PlaneBits &inner_bits = inner_bits_[std::size_t(k)],
                *outer_bits = outer ? &outer_bits_[std::size_t(k)] : nullptr;
      if (mesh_) {
        cast_mesh(d, inner_, scratch, inner_bits);
        if (outer) cast_mesh(d, outer_, scratch, *outer_bits);
        continue;
      }
      if (const int i = near_.light_of(d); i >= 0) {
        const glm::dvec3 at = near_.position(d, i);
        cast_near_bits(spheres_, at, inner_, inner_bits);
        if (outer) cast_near_bits(spheres_, at, outer_, *outer_bits);
        continue;
      }
      cast_bits(inner, d, inner_.size, inner_bits);
      if (outer) cast_bits(*outer, d, outer_.size, *outer_bits);
    }
  });
}

void DirectionShadow::cast_mesh(glm::vec3 direction, const PlaneGrid& grid,
                                ShadowTriangles::Scratch& scratch, PlaneBits& bits) const {
  clear(grid.size, bits);
  const int i = near_.light_of(direction);
  if (i >= 0)
    mesh_->draw(near_.projection(direction, i, glm::vec2(0)), grid, bits, scratch);
  else
    mesh_->draw(direction, grid, bits, scratch);
}

// Like sum_shares(), for near lights that give other points of the plane more or less light than
// the map's centre: sums what distant light leaves, and each near light.
void DirectionShadow::sum_near(std::span<const PlaneBits> bits, std::span<const glm::ivec4> shares,
                               const PlaneGrid& grid, Image<float>& ratio) const {
  const std::vector<LightDirection>& light = light_.directions();
  std::vector<glm::ivec4> own(shares.size());
  const auto choose = [&](int i) {  // returns the sum of the chosen ones
    glm::vec3 sum(0);
    for (std::size_t k = 0; k < shares.size(); ++k) {
      own[k] = near_.light_of(light[k].direction) == i ? shares[k] : glm::ivec4(0);
      sum += kShareUnit * glm::vec3(own[k]);
    }
    return sum;
  };
  choose(-1);
  sum_shares(bits, own, ratio);
  Image<float> lit(grid.size, grid.size, 3, 1.0f), left;  // by the light at the map's centre
  for (int i = 0; i < near_.count(); ++i) {
    const glm::vec3 sum = choose(i);
    sum_shares(bits, own, left);
    const float height = near_.height(i);
    for_rows(grid, [&](int y, const std::vector<glm::vec2>& points) {
      std::vector<float> falloff(points.size());
      near_.falloff(i, points, falloff);
      for (int x = 0; x < grid.size; ++x) {
        const float here = height * falloff[std::size_t(x)];
        for (int c = 0; c < 3; ++c) {
          ratio.pixel(x, y)[c] -= here * (1 - left.pixel(x, y)[c]);
          lit.pixel(x, y)[c] += (here - 1) * sum[c];
        }
      }
    });
  }
  for (std::size_t k = 0; k < ratio.data.size(); ++k) {
    const float lost = (1 - ratio.data[k]) / std::max(lit.data[k], 1e-6f);
    ratio.data[k] = std::clamp(1 - lost, 0.0f, 1.0f);
  }
}

void DirectionShadow::make_ratio() {
  const std::vector<glm::ivec4> shares = whole_shares(light_.directions());
  const auto make = [&](std::span<const PlaneBits> bits, const PlaneGrid& grid, bool fading,
                        Image<float>& ratio) {
    if (near_.count() == 0) return sum_shares(bits, shares, ratio, fading);
    sum_near(bits, shares, grid, ratio);
    if (fading) fade_border(ratio);
  };
  make(inner_bits_, inner_, !options_.outer, map_->ratio);
  if (outer_.extent > 0) {
    make(outer_bits_, outer_, true, map_->outer);
    map_->outer_extent = outer_.extent;
  } else {
    map_->outer = {};
    map_->outer_extent = 0;
  }
  if (options_.outer) join_border(*map_);
}

// A map that somebody still holds stays as it is.
void DirectionShadow::own_map() {
  if (is_sole_owner(map_)) return;
  auto fresh = std::make_shared<ShadowMap>();
  fresh->centre = map_->centre, fresh->extent = map_->extent;
  fresh->ignored_spheres = map_->ignored_spheres;
  map_ = std::move(fresh);
}

namespace {

// Spheres that place a mesh's map as a map of spheres is placed: corners of what is above the
// plane.
SphereSet corners_of(const ShadowTriangles& mesh) {
  if (mesh.empty()) return {};
  const Bounds box = mesh.box();
  const glm::vec3 size = box.upper - box.lower;
  const float radius = 1e-6f * std::max({size.x, size.y, size.z});
  SphereSet corners;
  for (const glm::vec3& corner : box.corners()) corners.emplace_back(corner, radius);
  return corners;
}

}  // namespace

std::shared_ptr<const ShadowMap> DirectionShadow::cast(const CubeMap& radiance,
                                                       const SphereSet& spheres,
                                                       const ShadowOptions& options,
                                                       const NearLights& near_lights) {
  check_options(options);  // before anything is replaced
  check(radiance.size() > 0, "the radiance map is empty");
  const bool moved = mesh_ || spheres != spheres_;
  mesh_ = nullptr;
  return cast_again(radiance, moved, spheres, options, near_lights);
}

std::shared_ptr<const ShadowMap> DirectionShadow::cast(const CubeMap& radiance,
                                                       std::shared_ptr<const ShadowTriangles> mesh,
                                                       const ShadowOptions& options,
                                                       const NearLights& near_lights) {
  check(mesh != nullptr, "expected a mesh, got none");
  check_options(options);
  check(radiance.size() > 0, "the radiance map is empty");
  const bool moved = mesh != mesh_;
  mesh_ = std::move(mesh);
  return cast_again(radiance, moved, moved ? corners_of(*mesh_) : spheres_, options, near_lights);
}

std::shared_ptr<const ShadowMap> DirectionShadow::cast_again(const CubeMap& radiance,
                                                             bool elsewhere,
                                                             const SphereSet& spheres,
                                                             const ShadowOptions& options,
                                                             const NearLights& near_lights) {
  const SteadyLight::Change change = light_.update(radiance);
  const bool other_lights = !near_.still_right(near_lights);
  if (other_lights) near_ = NearPlane(near_lights);
  const bool moved = map_->ratio.empty() || elsewhere || options != options_ || other_lights;
  if (change == SteadyLight::Change::none && !moved) return map_;
  own_map();
  if (moved) place(spheres, options);
  map_->no_light = light_.no_light();
  if (map_->no_light) {
    map_->ratio = Image<float>(inner_.size, inner_.size, 3, 1.0f);
    map_->outer = {};
    map_->outer_extent = 0;
    map_->ignored_spheres = PlaneSpheres(spheres, inner_).ignored();
    inner_bits_.clear();
    return map_;
  }
  if (moved || change == SteadyLight::Change::directions || inner_bits_.empty()) make_bits();
  make_ratio();
  return map_;
}

}  // namespace fastibl
