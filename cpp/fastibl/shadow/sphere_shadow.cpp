#include "fastibl/shadow/sphere_shadow.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/shared_formulas.h"
#include "fastibl/shadow/direction_shadow.h"
#include "fastibl/shadow/plane_bits.h"

namespace fastibl {
namespace {

constexpr int kResolution = 64;  // of a map, by default

// A sphere that can hold back light. In double, so that squares of 1e30 do not overflow.
struct Caster {
  double x, y, z;
  double r2;      // r²
  double beyond;  // (z − r)(z + r): with |p − (x, y)|² it is d² − r² without cancellation
  double look_up_z;  // middle of the part above the plane: the centre, unless the plane cuts it
  bool clipped;      // some of it may lie below the horizon
};

constexpr int kBlock = 64;  // points handled together

void check_irradiance(glm::vec3 irradiance) {
  for (int c = 0; c < 3; ++c)
    check(std::isfinite(irradiance[c]) && irradiance[c] >= 0,
          "the plane's irradiance must be finite and at least 0, got ", irradiance[c]);
}

// What the points of a block see of one sphere.
struct Caps {
  float sin2_alpha[kBlock], cos2_alpha[kBlock];  // cos² ≤ 0: the point is in the sphere or on it
  float cos_theta[kBlock];
  float level[kBlock];         // MIP level for the cap's solid angle
  float s[kBlock], t[kBlock];  // face_point() of the look-up
  std::int32_t face[kBlock];
};

// Within 3e-5 of log2 for x > 0: exponent, and a fit of log2(1 + m) that is exact at both ends.
inline float fast_log2(float x) {
  const std::int32_t bits = std::bit_cast<std::int32_t>(x);
  const float m = std::bit_cast<float>((bits & 0x007fffff) | 0x3f800000) - 1;
  const float rest = 0.44174f + m * (-0.26603f + m * (0.14631f - 0.04400f * m));
  return float((bits >> 23) - 127) + m + m * (1 - m) * rest;
}

// Plain loop over arrays, without a call or a branch: it is vectorised.
FASTIBL_CLONES
void see_caps(const Caster& c, const float* px, const float* py, float face_size, Caps& caps) {
  const float z = float(c.look_up_z);
  for (int i = 0; i < kBlock; ++i) {
    const double dx = c.x - px[i], dy = c.y - py[i], across2 = dx * dx + dy * dy;
    const double inverse_d2 = 1 / (across2 + c.z * c.z);
    const float sin2 = float(c.r2 * inverse_d2), cos2 = float((across2 + c.beyond) * inverse_d2);
    caps.sin2_alpha[i] = sin2, caps.cos2_alpha[i] = cos2;
    caps.cos_theta[i] = float(c.z * std::sqrt(inverse_d2));
    const float cos_alpha = std::sqrt(cos2 > 0 ? cos2 : 0);
    // shared::cap_mip_level, with the fast logarithm
    caps.level[i] = 0.5f * fast_log2(3 * face_size * face_size * sin2 / (1 + cos_alpha));
    // face_point() of a direction above the horizon
    const float x = float(dx), y = float(dy), ax = std::fabs(x), ay = std::fabs(y);
    const bool along_x = ax >= ay && ax > z, along_y = ay > ax && ay > z;
    const float major = along_x ? ax : along_y ? ay : z;
    const float s = along_x ? (x > 0 ? -z : z) : x;
    const float t = along_y ? (y > 0 ? z : -z) : -y;
    caps.face[i] = along_x ? (x > 0 ? 0 : 1) : along_y ? (y > 0 ? 2 : 3) : 4;
    caps.s[i] = s * (0.5f / major) + 0.5f;
    caps.t[i] = t * (0.5f / major) + 0.5f;
  }
}

// Four floats, of which the last is whatever follows: one SIMD register.
struct Texel {
  float v[4];
};

// Adds weight × the bilinear value.
void add_bilinear(const CubeLevel& level, const FacePoint& p, float weight, Texel& sum) {
  const float n = float(level.size());
  // min and max in this order turn the NaN of an overflow into 1: some texel, but one of the map.
  const float x = std::max(0.0f, std::min(1.0f, p.s)) * n + 0.5f,
              y = std::max(0.0f, std::min(1.0f, p.t)) * n + 0.5f;
  const int ix = int(x), iy = int(y);
  const float fx = x - float(ix), fy = y - float(iy);
  const float lower = weight * fy, upper = weight - lower, wb = upper * fx, wa = upper - wb,
              wd = lower * fx, wc = lower - wd;
  const float* a = &level.face(p.face)[(iy - 1) * level.row_stride() + (ix - 1)].x;
  const float* b = a + 3 * level.row_stride();
  for (int k = 0; k < 4; ++k) sum.v[k] += wa * a[k] + wb * a[k + 3] + wc * b[k] + wd * b[k + 3];
}

// CubeMap::sample, with the face already found.
glm::vec3 look_up(const CubeMap& cube, const FacePoint& p, float level) {
  const int last = cube.level_count() - 1;
  const float clamped = std::min(std::max(0.0f, level), float(last));
  const int k = int(clamped);
  const float f = clamped - float(k);
  Texel sum{};
  add_bilinear(cube.level(k), p, 1 - f, sum);
  if (k < last) add_bilinear(cube.level(k + 1), p, f, sum);
  return {sum.v[0], sum.v[1], sum.v[2]};
}

class Obstruction {
 public:
  Obstruction(const CubeMap& radiance, glm::vec3 irradiance, const SphereSet& spheres,
              ShadowMethod method)
      : radiance_(radiance), method_(method) {
    check(radiance.size() > 0, "the radiance map is empty");
    check_irradiance(irradiance);
    for (int c = 0; c < 3; ++c) {
      lit_[c] = irradiance[c] > kLeastIrradiance;
      inverse_[c] = lit_[c] ? 1 / irradiance[c] : 0;
    }
    for (const glm::vec4& s : spheres) {
      if (!is_sphere(s)) {
        ++ignored_;
        continue;
      }
      const double z = s.z, r = s.w;
      if (z + r <= 0) continue;
      casters_.push_back(
          {s.x, s.y, z, r * r, (z - r) * (z + r), std::max(z, 0.5 * (z + r)), z < r});
    }
  }

  bool no_light() const { return !lit_.x && !lit_.y && !lit_.z; }
  int ignored() const { return ignored_; }

  // Ratios at up to kBlock points, best near each other: the spheres are the outer loop, so that
  // neighbours read the same texels one after the other.
  void ratios(std::span<const glm::vec2> points, std::span<glm::vec3> out) const {
    std::fill(out.begin(), out.end(), glm::vec3(1));
    if (no_light()) return;
    float px[kBlock] = {}, py[kBlock] = {};
    for (std::size_t i = 0; i < points.size(); ++i)
      if (std::isfinite(points[i].x) && std::isfinite(points[i].y))
        px[i] = points[i].x, py[i] = points[i].y;
    Caps caps;
    for (const Caster& caster : casters_) {
      see_caps(caster, px, py, float(radiance_.size()), caps);
      for (std::size_t i = 0; i < points.size(); ++i) {
        if (!(caps.cos2_alpha[i] > 0)) {
          out[i] = glm::vec3(0);
        } else {
          const glm::vec3 o = hidden(caster, caps, i);
          const bool sum = method_ == ShadowMethod::cap_sum;
          const glm::vec3 left = sum ? out[i] - o : out[i] * (1.0f - o);
          // Far below what can be seen; the denormal numbers of a long product are slow.
          for (int c = 0; c < 3; ++c) out[i][c] = left[c] > 1e-9f ? left[c] : 0;
        }
      }
    }
    for (std::size_t i = 0; i < points.size(); ++i) {
      const bool somewhere = std::isfinite(points[i].x) && std::isfinite(points[i].y);
      for (int c = 0; c < 3; ++c)  // channels without light have nothing to lose
        if (!lit_[c] || !somewhere) out[i][c] = 1;
    }
  }

 private:
  glm::vec3 hidden(const Caster& caster, const Caps& caps, std::size_t i) const {
    const float sin2 = caps.sin2_alpha[i], cos_theta = caps.cos_theta[i];
    const float projected =
        caster.clipped ? shared::cap_projected_solid_angle(cos_theta, sin2, caps.cos2_alpha[i])
                       : kPi * sin2 * cos_theta;
    const glm::vec3 seen = look_up(radiance_, {caps.face[i], caps.s[i], caps.t[i]}, caps.level[i]);
    return shared::cap_obstruction(seen, projected, inverse_);
  }

  const CubeMap& radiance_;
  ShadowMethod method_;
  glm::bvec3 lit_{false};
  glm::vec3 inverse_{0};
  std::vector<Caster> casters_;
  int ignored_ = 0;
};

}  // namespace

std::vector<glm::vec3> shadow_ratio(const CubeMap& radiance, glm::vec3 plane_irradiance,
                                    const SphereSet& spheres, std::span<const glm::vec2> points,
                                    ShadowMethod method) {
  check(method == ShadowMethod::cap_sum || method == ShadowMethod::cap_product,
        "no method of caps: ", name(method));
  const Obstruction obstruction(radiance, plane_irradiance, spheres, method);
  std::vector<glm::vec3> ratios(points.size());
  parallel_for(int(points.size()), kBlock, [&](int begin, int end) {
    const std::size_t first = std::size_t(begin), count = std::size_t(end - begin);
    obstruction.ratios(points.subspan(first, count), std::span(ratios).subspan(first, count));
  });
  return ratios;
}

ShadowMap cast_shadow(const CubeMap& radiance, glm::vec3 plane_irradiance, const SphereSet& spheres,
                      const ShadowOptions& options) {
  check_options(options);
  check_irradiance(plane_irradiance);
  const ShadowMethod method = resolved(options.method);
  check(method != ShadowMethod::mesh, "the mesh method needs a baked mesh, got spheres");
  if (method == ShadowMethod::directions)
    return *DirectionShadow(options.settings.directions).cast(radiance, spheres, options);
  const int n = options.resolution > 0 ? options.resolution : kResolution;
  const Obstruction obstruction(radiance, plane_irradiance, spheres, method);
  ShadowMap map;
  place_map(spheres, options, map);
  map.ratio = Image<float>(n, n, 3, 1.0f);
  map.ignored_spheres = obstruction.ignored();
  map.no_light = obstruction.no_light();
  const auto offset = [&](int i) { return shared::plane_offset(i, float(n)); };
  const PlaneGrid grid{n, map.centre, map.extent};
  parallel_for(n, 1, [&](int begin, int end) {
    std::vector<glm::vec2> points(static_cast<std::size_t>(n));
    std::vector<glm::vec3> ratios(points.size());
    for (int y = begin; y < end; ++y) {
      grid.points(0, y, points);
      for (std::size_t x = 0; x < points.size(); x += kBlock) {
        const std::size_t count = std::min(std::size_t(kBlock), points.size() - x);
        obstruction.ratios(std::span(points).subspan(x, count),
                           std::span(ratios).subspan(x, count));
      }
      for (int x = 0; x < n; ++x) {
        const float keep = shared::shadow_keep({offset(x), offset(y)}, float(n));
        const glm::vec3 ratio = 1.0f + keep * (ratios[std::size_t(x)] - 1.0f);
        for (int c = 0; c < 3; ++c) map.ratio.pixel(x, y)[c] = ratio[c];
      }
    }
  });
  return map;
}

ShadowMap ShadowCaster::cast(const CubeMap& radiance, glm::vec3 plane_irradiance,
                             const SphereSet& spheres, const ShadowOptions& options,
                             const NearLights& near_lights) {
  if (resolved(options.method) != ShadowMethod::directions)
    return cast_shadow(radiance, plane_irradiance, spheres, options);
  const int count = options.settings.directions;
  if (!directions_ || directions_->light().count() != count) directions_.emplace(count);
  return *directions_->cast(radiance, spheres, options, near_lights);
}

}  // namespace fastibl
