#include "fastibl/render/measure_costs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "fastibl/core/clock.h"
#include "fastibl/core/lanes.h"
#include "fastibl/core/parallel.h"
#include "fastibl/lighting/fit_lighting.h"
#include "fastibl/render/make_scene.h"
#include "fastibl/shading/bounce.h"
#include "fastibl/shading/composite.h"
#include "fastibl/shading/glossy_shares.h"
#include "fastibl/shading/rasterize.h"
#include "fastibl/shading/self_shadow.h"
#include "fastibl/shading/shade.h"
#include "fastibl/shading/traced_lights.h"
#include "fastibl/shading/traced_shares.h"
#include "fastibl/shadow/scene_shadow.h"

namespace fastibl {
namespace {

constexpr int kCalls = 25, kFewest = 5;
constexpr double kLongest = 0.1;            // seconds, after which fewer calls are enough
constexpr std::size_t kBetween = 64 << 20;  // bytes: more than any cache
thread_local std::vector<unsigned char> others;

// Nanoseconds of call(k), where k is counted up. As in a frame, pictures and maps went through the
// caches since the last call. The lower quartile, so that what holds up the core counts for little.
template <typename Call>
double nanoseconds(Call&& call) {
  int k = 0;
  double all = 0;
  std::vector<double> seconds;
  while (k < kFewest || (k < kCalls && all < kLongest)) {
    for (std::size_t b = 0; b < others.size(); b += 64) ++others[b];
    const ProcessorClock clock(ProcessorClock::Of::thread);
    call(k++);
    seconds.push_back(clock.seconds());
    all += seconds.back();
  }
  const std::ptrdiff_t quarter = k / 4;
  std::nth_element(seconds.begin(), seconds.begin() + quarter, seconds.end());
  return 1e9 * seconds[std::size_t(quarter)];
}

double at_least(double value, double least) { return std::max(value, least); }

// Two different rooms with a window and a lamp, so that nothing is found ready.
using Maps = std::array<std::shared_ptr<const CubeMap>, 2>;
Maps maps() {
  Maps result;
  for (int m = 0; m < 2; ++m) {
    constexpr int n = 128;
    std::vector<glm::vec3> faces;
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) {
          const glm::vec3 d = glm::normalize(texel_direction(f, x, y, n));
          glm::vec3 light = glm::vec3(0.5f + 0.2f * d.x, 0.5f, 0.5f - 0.1f * d.y);
          const glm::vec3 lamp = glm::normalize(glm::vec3(0.3f, 0.4f + 0.01f * float(m), 0.85f));
          const glm::vec3 window = glm::normalize(glm::vec3(-0.8f, 0.1f * float(m), 0.5f));
          if (glm::dot(d, lamp) > 0.999f) light += glm::vec3(200);
          if (glm::dot(d, window) > 0.96f) light += glm::vec3(4, 5, 7);
          faces.push_back(light);
        }
    result[std::size_t(m)] = std::make_shared<const CubeMap>(n, faces);
  }
  return result;
}

// A ring on the plane: it hides light from itself.
Mesh ring() {
  constexpr int kAround = 60, kTube = 40;
  constexpr float kRadius = 0.07f, kThickness = 0.03f;
  Mesh mesh;
  for (int i = 0; i < kAround; ++i)
    for (int j = 0; j < kTube; ++j) {
      const float a = 2 * std::numbers::pi_v<float> * float(i) / kAround;
      const float b = 2 * std::numbers::pi_v<float> * float(j) / kTube;
      const float r = kRadius + kThickness * std::cos(b);
      mesh.vertices.emplace_back(r * std::cos(a), r * std::sin(a),
                                 kThickness + kThickness * std::sin(b));
      const auto at = [&](int u, int v) { return (u % kAround) * kTube + v % kTube; };
      mesh.triangles.emplace_back(at(i, j), at(i + 1, j), at(i + 1, j + 1));
      mesh.triangles.emplace_back(at(i, j), at(i + 1, j + 1), at(i, j + 1));
    }
  return mesh;
}

LightingOptions diffuse_by(DiffuseMethod method, DiffuseSettings settings = {}) {
  LightingOptions options;
  options.diffuse = method, options.diffuse_settings = settings;
  options.glossy = GlossyMethod::mip;
  return options;
}
LightingOptions glossy_by(GlossyMethod method, GlossySettings settings = {}) {
  LightingOptions options = diffuse_by(DiffuseMethod::sh9);
  options.glossy = method, options.glossy_settings = settings;
  return options;
}

// Time of fitting one map after the other.
double fit(const Maps& maps, LightingOptions options) {
  options.follows = true;
  Lighting last = fit_lighting(maps[1], options);
  return nanoseconds([&](int k) { last = fit_lighting(maps[std::size_t(k % 2)], options, &last); });
}

void measure_fits(const Maps& all, Costs& costs) {
  const double faces = fit(all, diffuse_by(DiffuseMethod::six_face));
  const double sh9 = fit(all, diffuse_by(DiffuseMethod::sh9));
  const double two = fit(all, diffuse_by(DiffuseMethod::sh9_lobes, {2, 16, 32}));
  const double eight = fit(all, diffuse_by(DiffuseMethod::sh9_lobes, {8, 16, 32}));
  const double cube = fit(all, diffuse_by(DiffuseMethod::irradiance_cube));
  costs.fold = at_least(faces - costs.faces, 1e3);
  costs.sh9 = at_least(sh9 - costs.fold, 100);
  costs.lobe = at_least((eight - two) / 6, 100);
  costs.lobes = at_least(two - sh9 - 2 * costs.lobe, 100);
  costs.cube = at_least(cube - costs.fold, 1e3);
  const double plain = fit(all, glossy_by(GlossyMethod::centroid, {0, 0}));
  const double lit = fit(all, glossy_by(GlossyMethod::centroid, {0, -1}));
  costs.chain = at_least(plain - sh9, 1e3);
  costs.lights = at_least(lit - plain, 0);
  const ProcessorClock clock(ProcessorClock::Of::thread);
  fit_lighting(all[0], glossy_by(GlossyMethod::prefiltered));
  costs.exact_chain = 1e9 * clock.seconds();
}

double texels(const ShadowMap& shadow) {
  return double(shadow.ratio.data.size() + shadow.outer.data.size() + shadow.fine.data.size()) / 3;
}

// Bytes of a picture that gets brighter to the right, with a camera's noise.
std::vector<std::uint8_t> noisy_picture(const Camera& camera) {
  std::vector<std::uint8_t> bytes;
  std::uint32_t noise = 1;
  for (int y = 0; y < camera.height; ++y)
    for (int i = 0; i < 3 * camera.width; ++i) {
      noise = 1664525 * noise + 1013904223;
      bytes.push_back(std::uint8_t(60 + 40 * i / camera.width + int(noise >> 28)));
    }
  return bytes;
}

struct View {
  Camera camera;
  Pose camera_from_marker;
};
View view(int width) {
  View v;
  v.camera.width = width, v.camera.height = width * 3 / 4;
  v.camera.fx = v.camera.fy = 1.5625 * width;
  v.camera.cx = 0.5 * width, v.camera.cy = 0.375 * width;
  const glm::dvec3 eye(0, -0.35, 0.3), z = glm::normalize(glm::dvec3(0, 0, 0.03) - eye);
  const glm::dvec3 x = glm::normalize(glm::cross(z, glm::dvec3(0, 0, 1))), y = glm::cross(z, x);
  const glm::dmat3 marker_from_camera(x, y, z);
  v.camera_from_marker.rotation = glm::transpose(marker_from_camera);
  v.camera_from_marker.translation = -(v.camera_from_marker.rotation * eye);
  return v;
}

void measure_pixels(const Scene& scene, const Maps& all, Costs& costs) {
  const View v = view(640);
  Rasterizer rasterizer;
  std::span<const FragmentBand> seen;
  const auto raster_of = [&](const View& at) {
    return nanoseconds([&](int) {
      seen = rasterizer.rasterize(scene, at.camera, at.camera_from_marker, {}, {}, true);
    });
  };
  const double quarter = raster_of(view(320)), raster = raster_of(v);
  const double of_pixels = std::clamp(4.0 / 3 * (raster - quarter), 0.2 * raster, 0.9 * raster);
  double count = 0;
  for (const FragmentBand& band : seen) count += double(band.object.size());
  const double pixels = at_least(count, 1);
  const glm::vec3 eye(v.camera_from_marker.inverse().translation);
  const auto shading = [&](const Material& material, const LightingOptions& options) {
    const Lighting lighting = fit_lighting(all[0], options);
    return nanoseconds([&](int) { shade(seen, material, lighting, eye); }) / pixels;
  };
  Material matte, mirror;
  mirror.diffuse = glm::vec3(0), mirror.glossy = glm::vec3(0.8f), mirror.exponent = 64;
  const double sh9 = shading(matte, diffuse_by(DiffuseMethod::sh9));
  costs.raster_vertex = (raster - of_pixels) / double(scene.mesh.vertices.size());
  costs.raster_pixel = of_pixels / pixels + at_least(sh9 - costs.read_sh9, 1);
  const double base = at_least(sh9 - costs.read_sh9, 1);
  costs.read_cube = at_least(shading(matte, diffuse_by(DiffuseMethod::irradiance_cube)) - base, 1);
  costs.read_faces = at_least(shading(matte, diffuse_by(DiffuseMethod::six_face)) - base, 1);
  const double lobes = shading(matte, diffuse_by(DiffuseMethod::sh9_lobes, {8, 16, 32})) - base;
  costs.read_lobe = at_least((lobes - costs.read_sh9) / 8, 0.05);
  costs.mip = at_least(shading(mirror, glossy_by(GlossyMethod::mip)) - base, 1);
  costs.look_up = at_least(shading(mirror, glossy_by(GlossyMethod::centroid, {0, 0})) - base, 1);
  const LightingOptions with_lights = glossy_by(GlossyMethod::centroid, {0, -1});
  const double lit = shading(mirror, with_lights) - base;
  const std::size_t lights = fit_lighting(all[0], with_lights).chain->lights.size();
  costs.light = at_least((lit - costs.look_up) / at_least(double(lights), 1), 0);
  const double three = shading(mirror, glossy_by(GlossyMethod::stretched, {3, 0})) - base;
  costs.more_look_ups = at_least((three - costs.look_up) / 2, 1);
  costs.sample =
      at_least(shading(mirror, glossy_by(GlossyMethod::sampled, {64, -1})) - base, 1) / 64;
  PbrMaterial metal;
  metal.metallic = 1, metal.roughness = 0.4f;
  costs.ggx =
      at_least(shading(Material::make_pbr(metal), glossy_by(GlossyMethod::centroid)) - base, 1);

  const Lighting lighting = fit_lighting(all[0], diffuse_by(DiffuseMethod::sh9));
  const ObjectLayer object = shade(seen, matte, lighting, eye);
  SceneShadow caster;
  const ShadowMap shadow = caster.cast(*all[0], lighting.plane_irradiance, scene);
  const ShadowLookUp nothing{ShadowMap{}}, look_up(shadow);
  const PixelTable table(v.camera);
  const std::vector<std::uint8_t> bytes = noisy_picture(v.camera);
  Picture back;
  back.width = v.camera.width, back.height = v.camera.height;
  back.data = bytes.data(), back.row_bytes = 3 * v.camera.width;
  const double all_pixels = double(v.camera.width) * v.camera.height;
  const double bare =
      nanoseconds([&](int) { composite(back, 1, table, v.camera_from_marker, object, nothing); });
  const double shaded =
      nanoseconds([&](int) { composite(back, 1, table, v.camera_from_marker, object, look_up); });
  const double ready = nanoseconds([&](int) { const ShadowLookUp again(shadow); });
  costs.composite_pixel = bare / all_pixels;
  costs.shadow_texel = ready / texels(shadow);
  costs.shadow_pixel = at_least((shaded - bare) / all_pixels, 0.1);
}

void measure_shadows(const Scene& scene, const Maps& all, Costs& costs) {
  const Lighting lighting = fit_lighting(all[0], diffuse_by(DiffuseMethod::sh9));
  const auto shadow = [&](ShadowMethod method, ShadowSettings settings) {
    SceneShadow caster;
    ShadowOptions options;
    options.method = method, options.settings = settings;
    return nanoseconds([&](int k) {
      caster.cast(*all[std::size_t(k % 2)], lighting.plane_irradiance, scene, options);
    });
  };
  costs.mesh_shadow = shadow(ShadowMethod::mesh, {});
  costs.fine_shadow = at_least(shadow(ShadowMethod::mesh, {256, 512}), costs.mesh_shadow);
  costs.direction = shadow(ShadowMethod::directions, {64}) / 64;
  costs.caps = shadow(ShadowMethod::cap_product, {});
}

// Shares in a picture of the ring, diffuse and glossy: by rays, for each pixel; and with a pixel's
// own lobe, for each group of cells in its reach.
struct PixelShares {
  double traced, glossy;
};
PixelShares pixel_shares(Scene scene, const Lighting& lighting, const CellLight& light,
                         std::vector<glm::vec4> shares) {
  scene.material.glossy = glm::vec3(0.3f);
  const View v = view(160);
  const glm::vec3 eye(v.camera_from_marker.inverse().translation);
  Rasterizer rasterizer;
  const std::span<FragmentBand> seen =
      rasterizer.rasterize(scene, v.camera, v.camera_from_marker, shares);
  double count = 0, touched = 0;
  for (const FragmentBand& band : seen)
    for (const Fragment& f : band.object) ++count, touched += is_touched(f.share.w);
  count = at_least(count, 1), touched = at_least(touched, 1);
  GlossyPixelShares glossy;
  PixelShares costs{};
  costs.glossy = nanoseconds([&](int) { glossy(scene, light, eye, seen); }) / touched /
                 lobe_groups(scene.material.lobe());
  const ProcessorClock clock(ProcessorClock::Of::thread);
  trace_shares(scene, lighting, eye, {shares, {}}, nullptr, seen);
  costs.traced = 1e9 * clock.seconds() / count;
  return costs;
}

// Rays from pixels of the ring, which is tilted so that it hides a lamp from itself; and sums of
// the lobe over all of them.
void measure_rays(Scene scene, const CubeMap& map, const Irradiance& irradiance, Costs& costs) {
  scene.marker_from_object.rotation = glm::dmat3(1, 0, 0, 0, 0.5, 0.87, 0, -0.87, 0.5);
  const View v = view(320);
  Rasterizer rasterizer;
  const std::vector<glm::vec4> shares(scene.mesh.vertices.size(), glm::vec4(1));
  const std::span<FragmentBand> seen =
      rasterizer.rasterize(scene, v.camera, v.camera_from_marker, shares);
  const glm::mat3 light_from_map = glm::transpose(glm::mat3(scene.marker_from_object.rotation));
  CellLight light;
  light.update(map, light_from_map, scene.directions->size);
  TracedLights lights;
  double rays = 0;
  const double traced = nanoseconds([&](int) {
    rays = lights(scene, map, light, irradiance, v.camera, v.camera_from_marker, {shares, {}},
                  nullptr, seen);
  });
  costs.light_ray = traced / at_least(rays, 1);
  const BrightCells cells(map, light, light_from_map, glm::mat3(1));
  BrightCells::Seen all;
  all.free.assign(cells.rays().size() + kLanes, 1);
  const LobeHeight lobe(LobeShape{});
  constexpr int kPlaces = 200;
  float sum = 0;
  int looked = 0;
  const std::uint64_t every =
      cells.empty() ? 0 : ~std::uint64_t{0} >> (BrightCells::kMost - int(cells.cells().size()));
  const double sums = nanoseconds([&](int) {
    looked = 0;
    for (int k = 0; k < kPlaces; ++k)
      sum += cells
                 .lobe_sums(all, glm::normalize(glm::vec3(k, 0, kPlaces)), {0, 0, 1}, lobe, every,
                            looked)
                 .all;
  });
  // The sum is never negative.
  costs.bright_ray = at_least(sum < 0 ? 0 : sums, 1) / at_least(double(looked), 1);
}

void measure_shares(const Scene& scene, const Maps& all, Costs& costs) {
  const Lighting lighting = fit_lighting(all[0], diffuse_by(DiffuseMethod::sh9));
  CellLight light;
  costs.cells = nanoseconds(
      [&](int k) { light.update(*all[std::size_t(k % 2)], glm::mat3(1), scene.directions->size); });
  const double count = double(scene.mesh.vertices.size());
  std::vector<glm::vec4> shares(scene.mesh.vertices.size(), glm::vec4(1));
  costs.share_edge = nanoseconds([&](int) {
                       diffuse_shares(*scene.directions, light, lighting.irradiance, scene.normals,
                                      glm::mat3(1), shares);
                     }) /
                     double(scene.directions->edges.size());
  costs.vertex_group = nanoseconds([&](int) {
                         glossy_shares(*scene.directions, light, {}, scene.mesh.vertices,
                                       scene.normals, {0, -0.35f, 0.3f}, shares);
                       }) /
                       count / lobe_groups(LobeShape{});
  const PixelShares by_pixel = pixel_shares(scene, lighting, light, shares);
  costs.traced_pixel = by_pixel.traced, costs.pixel_group = by_pixel.glossy;
  measure_rays(scene, *all[0], lighting.irradiance, costs);
  SceneShadow caster;
  const ShadowMap shadow = caster.cast(*all[0], lighting.plane_irradiance, scene);
  const PlaneExchange exchange(scene.mesh, *scene.directions);
  Bounce bounce;
  const double whole =
      nanoseconds([&](int) { bounce = find_bounce(exchange, scene, lighting, shadow, shares); });
  const std::vector<glm::vec3> sent(scene.mesh.vertices.size(), glm::vec3(1));
  const double sums = nanoseconds([&](int) { exchange.onto_object(exchange.onto_plane(sent)); });
  costs.bounce_group = sums / double(std::max<std::size_t>(exchange.groups(), 1));
  costs.bounce = at_least(whole - sums, 1e3);
  costs.plane_texel = nanoseconds([&](int) { plane_gain(shadow, {}, bounce); }) / texels(shadow);
}

}  // namespace

Costs measure_costs() {
  const OneThread loops(OneThread::Loops::alone);
  others.assign(kBetween, 0);
  Costs costs;
  const Maps all = maps();
  SceneOptions options;
  options.bake_shadow = true;
  const Scene scene = make_scene(ring(), Material{}, {}, options);
  measure_fits(all, costs);
  measure_pixels(scene, all, costs);
  measure_shadows(scene, all, costs);
  measure_shares(scene, all, costs);
  const Costs usual;
  const double factor = (costs.fold + costs.cube + costs.chain + costs.cells) /
                        (usual.fold + usual.cube + usual.chain + usual.cells);
  costs.track = usual.track * factor, costs.capture_pixel = usual.capture_pixel * factor;
  costs.mips = usual.mips * factor;
  others = {};
  return costs;
}

}  // namespace fastibl
