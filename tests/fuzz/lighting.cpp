// Maps of any size and content, lit by every method and setting.
#include "fastibl/lighting/find_near_lights.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/lighting/prefilter.h"
#include "fastibl/scene/equirect.h"
#include "fastibl/scene/ggx.h"
#include "fastibl/scene/glossy.h"
#include "fastibl/scene/main_lights.h"
#include "pictures.h"

namespace fastibl {
namespace {

float largest(const CubeMap& map) {
  float most = 0;
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < map.size(); ++y)
      for (int x = 0; x < map.size(); ++x) {
        const glm::vec3& t = map.level(0).texel(f, x, y);
        most = std::max({most, t.x, t.y, t.z});
      }
  return most;
}

// The light must be a mean of the map, within the overshoot of fits.
void require_mean(const glm::vec3& light, float most, const char* what) {
  require(is_light(light), what);
  require(std::max({light.x, light.y, light.z}) <= 4 * most, what);
}

CubeMap map_of(Input& in) {
  if (!in.chance(4)) return any_map(in, 17);
  const int width = in.between(1, 24), height = in.between(1, 12);
  std::vector<float> pixels(std::size_t(3 * width * height), in.share());
  for (int i = in.below(8); i > 0; --i)
    pixels[std::size_t(in.below(int(pixels.size())))] = in.any();
  return cubemap_from_equirect({pixels.data(), width, height, 3, 3 * width}, in.between(1, 12),
                               EquirectFilter(in.below(2)));
}

LightingOptions options_of(Input& in) {
  LightingOptions options;
  options.diffuse = DiffuseMethod(in.below(int(DiffuseMethod::irradiance_cube) + 1));
  options.glossy = GlossyMethod(in.below(int(GlossyMethod::prefiltered)));
  if (in.chance(64))
    options.glossy = GlossyMethod::prefiltered;  // takes as long as a hundred others
  for (const auto& s : settings_of(options.diffuse))
    if (in.chance(2)) options.diffuse_settings.*s.value = in.between(s.least, std::min(s.most, 32));
  for (const auto& s : settings_of(options.glossy))
    if (in.chance(2)) options.glossy_settings.*s.value = in.between(s.least, std::min(s.most, 32));
  options.normalization = Normalization(in.below(3));
  options.evaluations = in.chance(2) ? in.below(1000) : 0;
  options.follows = in.chance(2);
  return options;
}

void evaluate_all(Input& in, const Lighting& lighting, float most) {
  for (int i = 0; i < 3; ++i) {
    const glm::vec3 n = in.unit(), v = in.unit();
    require_mean(evaluate(lighting.irradiance, n) / 3.1415927f, most, "irradiance");
    const float s = in.chance(2) ? std::fabs(in.any()) : std::exp2(20 * in.share());
    if (!std::isnan(s)) require_mean(evaluate_glossy(lighting, n, v, s), most, "glossy light");
    const SurfaceFrame frame = frame_around(n, in.chance(4) ? in.any3() : in.unit());
    const glm::vec2 alpha(in.within(kSmallestAlpha, 1), in.within(kSmallestAlpha, 1));
    // Near a light, the result may be any multiple of the map's.
    const glm::vec3 place = in.near3();
    const bool placed = in.chance(3);
    const GgxMethod method = kGgxMethods[size_t(in.below(int(kGgxMethods.size())))];
    const GgxOptions options{method, in.chance(2) ? kGgxTaps : in.between(1, kMostGgxTaps)};
    const glm::vec2 shape = in.chance(2) ? glm::vec2(alpha.x) : alpha;  // round ones have a table
    const GgxShading shading(lighting);
    const GgxLight light = shading(frame, v, shape, options, placed ? &place : nullptr);
    require(light.albedo > 0 && light.edge_share >= 0 && light.edge_share <= 1, "GGX lobe");
    require_mean(light.front, most, "GGX light but its edge");
    require_mean(light.edge, most, "GGX light of the edge");
    require_mean(light.mean(), placed ? std::numeric_limits<float>::infinity() : most, "GGX light");
    GgxLight eight;  // as for many round lobes
    shading({&n, 1}, {&v, 1}, {&alpha.x, 1}, {&place, placed ? 1u : 0u}, {&eight, 1});
    require(eight.albedo > 0 && eight.edge_share >= 0 && eight.edge_share <= 1, "round GGX lobe");
    require_mean(eight.front, most, "round GGX light but its edge");
    require_mean(eight.edge, most, "round GGX light of the edge");
  }
}

Environment environment_of(Input& in, const CubeMap& map) {
  Environment environment = environment_from(map);
  for (int i = in.below(3); i > 0; --i) {
    LightPosition light;
    light.direction = glm::dvec3(in.unit());
    light.position =
        in.chance(3) ? glm::dvec3(in.any3()) : glm::dvec3(in.unit()) * double(in.share());
    light.covariance = glm::dmat3(in.chance(3) ? in.any_double() : 1e-6);
    light.radius = in.chance(3) ? in.any_double() : 0.1 * in.share();
    environment.light_positions.push_back(light);
  }
  if (in.chance(4))
    environment.box = RoomBox{glm::dvec3(-1 - in.share()), glm::dvec3(1 + in.share()), in.share()};
  return environment;
}

}  // namespace

void fuzz(Input& in) {
  const auto map = std::make_shared<const CubeMap>(map_of(in));
  require(is_clean(*map), "levels of a map");
  const float most = largest(*map);
  LightingOptions options = options_of(in);
  Lighting lighting = fit_lighting(map, options);
  evaluate_all(in, lighting, most);
  if (in.chance(3)) {
    const auto later = std::make_shared<const CubeMap>(any_map(in, 17));
    evaluate_all(in, fit_lighting(later, options, &lighting), largest(*later));
  }
  if (in.chance(3)) {
    const Environment environment = environment_of(in, *map);
    options.environment = &environment;
    Lighting placed = fit_lighting(map, options);
    for (int i = 0; i < 3; ++i)
      require(is_light(GlossyShading(placed, std::exp2(20 * in.share()))(in.unit(), in.unit(),
                                                                         in.near3())),
              "glossy light at a place");
  }
  for (const MainLight& light : main_lights(*map))
    require(finite(light.direction) && is_light(light.irradiance) && is_ratio(light.share),
            "main light");
  if (in.chance(8)) {
    const auto levels =
        prefilter(map, std::vector<PrefilterLevel>{{in.any_double(), in.between(1, 4)}},
                  {LobeModel(in.below(3)), 0.05});
    require(is_clean(levels[0]), "prefiltered level");
  }
  if (in.chance(8))
    for (const float v : equirect_from_cubemap(*map, in.between(1, 12)).data)
      require(std::isfinite(v) && v >= 0, "picture of a map");
}

}  // namespace fastibl
