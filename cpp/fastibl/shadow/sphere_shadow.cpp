#include "fastibl/shadow/sphere_shadow.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

constexpr float kNegligible = 1e-6f;    // obstruction below which a sphere is skipped at a point
constexpr float kDefaultExtent = 3.0f;  // × the half width of the spheres
constexpr float kFarthest = 1e30f;      // metres; keeps centre and extent finite for any sphere

bool usable(const glm::vec4& s) {
  return std::isfinite(s.x) && std::isfinite(s.y) && std::isfinite(s.z) && std::isfinite(s.w) &&
         s.w > 0;
}

// A sphere that can hold back light. In double, so that squares of 1e30 do not overflow.
struct Caster {
  double x, y, z;
  double r2;      // r²
  double beyond;  // (z − r)(z + r): with |p − (x, y)|² it is d² − r² without cancellation
  double look_up_z;  // middle of the part above the plane: the centre, unless the plane cuts it
  bool clipped;      // some of it may lie below the horizon
};

class Obstruction {
 public:
  Obstruction(const CubeMap& radiance, glm::vec3 irradiance, const SphereSet& spheres,
              ShadowMethod method)
      : radiance_(radiance), method_(method) {
    check(radiance.size() > 0, "the radiance map is empty");
    float largest = 0;
    for (int c = 0; c < 3; ++c) {
      check(std::isfinite(irradiance[c]) && irradiance[c] >= 0,
            "the plane's irradiance must be finite and at least 0, got ", irradiance[c]);
      // 1e-30: the inverse of a smaller one, times a radiance of 1e9, is not finite.
      lit_[c] = irradiance[c] > 1e-30f;
      inverse_[c] = lit_[c] ? 1 / irradiance[c] : 0;
      const CubeLevel& base = radiance.level(0);
      for (int f = 0; f < 6; ++f)
        for (int y = 0; y < base.size(); ++y)
          for (int x = 0; x < base.size(); ++x)
            largest = std::max(largest, base.texel(f, x, y)[c] * inverse_[c]);
    }
    // Upper bound of o is max(L / E) π r²/d², and r²/d² where the uniform share takes over.
    negligible_ = kNegligible / std::max(kPi * largest, 1.0f);
    for (const glm::vec4& s : spheres) {
      if (!usable(s)) {
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

  glm::vec3 ratio(glm::vec2 point) const {
    if (no_light() || !std::isfinite(point.x) || !std::isfinite(point.y)) return glm::vec3(1);
    glm::vec3 left(1);
    for (const Caster& s : casters_) {
      const double dx = s.x - point.x, dy = s.y - point.y, across2 = dx * dx + dy * dy;
      const double outside2 = across2 + s.beyond;  // d² − r²
      if (!(outside2 > 0)) return unlit(glm::vec3(0));
      const double d2 = across2 + s.z * s.z;
      if (s.r2 < negligible_ * d2) continue;
      const double inverse_d2 = 1 / d2;
      const float sin2_alpha = float(s.r2 * inverse_d2), cos2_alpha = float(outside2 * inverse_d2);
      const float cos_theta = float(s.z * std::sqrt(inverse_d2));
      const float projected =
          s.clipped ? shared::cap_projected_solid_angle(cos_theta, sin2_alpha, cos2_alpha)
                    : kPi * sin2_alpha * cos_theta;
      const glm::vec3 seen =
          radiance_.sample({float(dx), float(dy), float(s.look_up_z)},
                           shared::cap_mip_level(sin2_alpha, cos2_alpha, float(radiance_.size())));
      const glm::vec3 o = shared::cap_obstruction(seen, projected, inverse_);
      if (method_ == ShadowMethod::cap_sum)
        left = glm::max(left - o, 0.0f);
      else
        left *= 1.0f - o;
    }
    return unlit(left);
  }

 private:
  glm::vec3 unlit(glm::vec3 ratio) const {  // channels without light have nothing to lose
    for (int c = 0; c < 3; ++c)
      if (!lit_[c]) ratio[c] = 1;
    return ratio;
  }

  const CubeMap& radiance_;
  ShadowMethod method_;
  glm::bvec3 lit_{false};
  glm::vec3 inverse_{0};
  double negligible_ = 0;
  std::vector<Caster> casters_;
  int ignored_ = 0;
};

// Middle and half width (x = y) of the spheres' box on the plane; 1 m around 0 when there is none.
void frame(const SphereSet& spheres, const ShadowOptions& options, ShadowMap& map) {
  glm::vec2 lower(std::numeric_limits<float>::max()), upper(-lower);
  for (const glm::vec4& s : spheres)
    if (usable(s) && s.z + s.w > 0)
      for (int i = 0; i < 2; ++i)
        lower[i] = std::min(lower[i], std::max(s[i] - s.w, -kFarthest)),
        upper[i] = std::max(upper[i], std::min(s[i] + s.w, kFarthest));
  const bool any = lower.x <= upper.x;
  map.centre = options.centre.value_or(any ? 0.5f * lower + 0.5f * upper : glm::vec2(0));
  map.extent = options.extent;
  if (map.extent == 0)
    map.extent =
        any ? kDefaultExtent * 0.5f * std::max(upper.x - lower.x, upper.y - lower.y) : 1.0f;
}

}  // namespace

std::vector<glm::vec3> shadow_ratio(const CubeMap& radiance, glm::vec3 plane_irradiance,
                                    const SphereSet& spheres, std::span<const glm::vec2> points,
                                    ShadowMethod method) {
  const Obstruction obstruction(radiance, plane_irradiance, spheres, method);
  std::vector<glm::vec3> ratios(points.size());
  parallel_for(int(points.size()), 64, [&](int begin, int end) {
    for (int i = begin; i < end; ++i)
      ratios[std::size_t(i)] = obstruction.ratio(points[std::size_t(i)]);
  });
  return ratios;
}

ShadowMap cast_shadow(const CubeMap& radiance, glm::vec3 plane_irradiance, const SphereSet& spheres,
                      const ShadowOptions& options) {
  const int n = options.resolution;
  check(n >= 2 && n <= 8192, "the shadow map's resolution must be 2 to 8192, got ", n);
  check(std::isfinite(options.extent) && options.extent >= 0,
        "the shadow map's extent must be finite and at least 0 (0: from the spheres), got ",
        options.extent);
  if (options.centre)
    check(std::isfinite(options.centre->x) && std::isfinite(options.centre->y),
          "the shadow map's centre must be finite");
  const Obstruction obstruction(radiance, plane_irradiance, spheres, options.method);
  ShadowMap map;
  frame(spheres, options, map);
  map.ratio = Image<float>(n, n, 3, 1.0f);
  map.ignored_spheres = obstruction.ignored();
  map.no_light = obstruction.no_light();
  const auto offset = [&](int i) { return shared::plane_offset(i, float(n)); };
  parallel_for(n, 1, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < n; ++x) {
        const glm::vec2 p(offset(x), offset(y));
        const float keep = shared::shadow_keep(p, float(n));
        if (keep == 0) continue;
        const glm::vec3 ratio = obstruction.ratio(map.centre + map.extent * p);
        for (int c = 0; c < 3; ++c) map.ratio.pixel(x, y)[c] = 1 + keep * (ratio[c] - 1);
      }
  });
  return map;
}

}  // namespace fastibl
