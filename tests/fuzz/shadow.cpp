// Hostile spheres, grids, points and light.
#include <utility>

#include "fastibl/shadow/direction_shadow.h"
#include "fastibl/shadow/ratio_at.h"
#include "fastibl/shadow/sphere_shadow.h"
#include "pictures.h"

namespace fastibl {
namespace {

glm::vec4 sphere(Input& in) {
  const glm::vec4 s(in.any3(), in.any());
  switch (in.below(4)) {
    case 0:
      return {s.x, s.y, s.w, s.w};  // tangent
    case 1:
      return {s.x, s.y, 0.2f - s.w, s.w};  // a crest of 0.2
    case 2:
      return {in.near3(), std::fabs(in.near())};
    default:
      return s;
  }
}

SphereSet spheres(Input& in, int most) {
  SphereSet set;
  for (int n = in.below(most + 1); n > 0; --n) set.push_back(sphere(in));
  return set;
}

glm::vec3 upwards(Input& in) {
  const float z = in.below(3) ? std::fabs(in.near()) + 1e-3f : 1e-3f;
  return glm::normalize(glm::vec3(in.below(4) ? in.near() : 0, in.below(4) ? in.near() : 0, z));
}

NearLights near_lights(Input& in) {
  NearLights lights;
  lights.centre = {0, 0, in.share()};
  for (int n = in.below(3); n > 0; --n)
    lights.lights.push_back({in.unit(), std::fabs(in.chance(3) ? in.near() : 0), 0.2f * in.share(),
                             glm::vec3(in.share())});
  return lights;
}

void cast_bits(Input& in, const SphereSet& set) {
  const float extent = std::fabs(in.any());
  PlaneGrid grid{
      1 + in.below(70), {in.near(), in.near()}, std::isfinite(extent) && extent > 0 ? extent : 1};
  if (in.below(8) == 0) grid.centre = {1e30f, -1e30f};
  PlaneBits bits(grid.size);
  const PlaneSpheres on_plane(set, grid);
  require(on_plane.size() + on_plane.ignored() <= int(set.size()), "counts");
  on_plane.add_shadow(upwards(in), bits);
  for (int c = 0; c < bits.columns(); ++c)
    for (int y = 0; y < bits.padded_rows(); ++y) {
      const int left = y < grid.size ? grid.size - 64 * c : 0;
      const std::uint64_t outside = left >= 64 ? 0 : ~std::uint64_t{0} << left;
      require((std::as_const(bits).column(c)[y] & outside) == 0, "bit outside the grid");
    }
}

void check_map(Input& in, const ShadowMap& map) {
  for (const float r : map.ratio.data) require(is_ratio(r), "ratio of the map");
  for (const float r : map.outer.data) require(is_ratio(r), "ratio of the outer map");
  require(std::isfinite(map.extent) && std::isfinite(map.outer_extent), "extent");
  glm::vec2 points[8];
  glm::vec3 ratios[8];
  for (glm::vec2& p : points) p = {in.any(), in.any()};
  map.sample(points, ratios);
  for (const glm::vec3& r : ratios) require(is_ratio(r), "sample");
}

}  // namespace

void fuzz(Input& in) {
  const SphereSet set = spheres(in, 3);
  cast_bits(in, set);
  if (!in.chance(8)) return;
  const CubeMap cube = any_map(in, 9);
  ShadowOptions options;
  options.resolution = 2 + in.below(40);
  options.outer = in.below(2);
  if (in.below(2)) options.extent = in.chance(4) ? in.any() : 2;
  if (in.chance(8)) options.centre = glm::vec2(in.any(), in.any());
  DirectionShadow caster(16);
  const NearLights near = near_lights(in);
  check_map(in, *caster.cast(cube, set, options, near));
  check_map(in, *caster.cast(any_map(in, 9), spheres(in, 3), options, near));
  glm::vec2 points[4];
  for (glm::vec2& p : points) p = {in.any(), in.any()};
  for (const glm::vec3& r : ratio_at(points, set, light_directions(cube, 8)))
    require(is_ratio(r), "ratio at a point");
  const glm::vec3 irradiance = in.chance(4) ? in.any3() : glm::vec3(1);
  for (const ShadowMethod method : {ShadowMethod::cap_sum, ShadowMethod::cap_product})
    for (const glm::vec3& r : shadow_ratio(cube, irradiance, set, points, method))
      require(is_ratio(r), "ratio of caps");
}

}  // namespace fastibl
