#include "fastibl/shading/shade.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

glm::vec3 read_map(const std::shared_ptr<const SurfaceTexture>& map, const Fragment& f) {
  return map ? map->sample(f.uv, map->level_of(f.uv_dx, f.uv_dy)) : glm::vec3(1);
}

// A pbr material at one point.
struct SurfacePoint {
  glm::vec3 base_color, emission;
  float metallic, roughness;
};
SurfacePoint point_of(const Fragment& f, const PbrMaterial& m) {
  return {m.base_color * f.color * read_map(m.base_color_map, f),
          m.emission * read_map(m.emission_map, f), m.metallic * read_map(m.metallic_map, f).x,
          m.roughness * read_map(m.roughness_map, f).x};
}

glm::vec3 mapped_normal(const Fragment& f, const PbrMaterial& m) {
  if (!m.normal_map) return f.normal;
  const SurfaceFrame frame = frame_around(f.normal, glm::vec3(f.tangent));
  glm::vec3 n = read_map(m.normal_map, f);
  n.x *= m.normal_scale, n.y *= m.normal_scale * f.tangent.w;
  const glm::vec3 bent = n.x * frame.tangent + n.y * frame.bitangent + n.z * frame.normal;
  return glm::dot(bent, bent) > 1e-12f ? glm::normalize(bent) : f.normal;
}
// The tangent is the rougher direction.
SurfaceFrame frame_of(const Fragment& f, const PbrMaterial& m, glm::vec3 normal) {
  const SurfaceFrame frame = frame_around(normal, glm::vec3(f.tangent));
  if (m.anisotropy == 0 || m.anisotropy_rotation == 0) return frame;
  const float c = std::cos(m.anisotropy_rotation),
              s = std::sin(m.anisotropy_rotation) * f.tangent.w;
  return frame_around(normal, c * frame.tangent + s * frame.bitangent);
}

constexpr std::size_t kBatch = 256;  // fragments that are shaded together

// At most kBatch fragments.
void shade_pbr(std::span<const Fragment> fragments, const Material& material,
               const Lighting& lighting, const GgxShading& ggx, glm::vec3 eye,
               std::span<glm::vec3> colours) {
  const PbrMaterial& m = *material.pbr;
  const std::size_t count = fragments.size();
  SurfacePoint points[kBatch];
  glm::vec3 normals[kBatch], views[kBatch], positions[kBatch], irradiance[kBatch];
  float alphas[kBatch];
  glm::vec2 albedos[kBatch];
  GgxLight lights[kBatch];
  for (std::size_t i = 0; i < count; ++i) {
    const Fragment& f = fragments[i];
    points[i] = point_of(f, m), normals[i] = mapped_normal(f, m), positions[i] = f.position;
    views[i] = glm::normalize(eye - f.position);
  }
  if (m.anisotropy == 0 && lighting.glossy != GlossyMethod::sampled) {  // round: no frame
    for (std::size_t i = 0; i < count; ++i) {
      alphas[i] = ggx_alpha(points[i].roughness, 0).x;
      albedos[i] =
          material.albedo->sample({0, 0, glm::dot(views[i], normals[i])}, points[i].roughness);
    }
    ggx({normals, count}, {views, count}, {alphas, count}, {positions, count}, {lights, count});
  } else {
    for (std::size_t i = 0; i < count; ++i) {
      const SurfaceFrame frame = frame_of(fragments[i], m, normals[i]);
      const glm::vec3 local(glm::dot(views[i], frame.tangent), glm::dot(views[i], frame.bitangent),
                            glm::dot(views[i], normals[i]));
      albedos[i] = material.albedo->sample(local, points[i].roughness);
      lights[i] = ggx(frame, views[i], ggx_alpha(points[i].roughness, m.anisotropy),
                      GgxOptions::for_shading(lighting, m.anisotropy), &positions[i]);
    }
  }
  const bool diffuse = material.reads_irradiance();
  const glm::vec4 dielectric = m.dielectric();
  if (diffuse) evaluate(lighting.irradiance, {normals, count}, {irradiance, count});
  for (std::size_t i = 0; i < count; ++i) {
    const SurfacePoint& p = points[i];
    const glm::vec4 share = fragments[i].share;
    colours[i] = p.emission;
    if (diffuse)
      colours[i] += shared::pbr_diffuse(p.base_color, p.metallic, dielectric, albedos[i]) *
                    (glm::vec3(share) / kPi) * irradiance[i];
    colours[i] += share.w * shared::pbr_reflected(p.base_color, p.metallic, dielectric, albedos[i],
                                                  lights[i].front_light(albedos[i]),
                                                  lights[i].edge_light(albedos[i]));
  }
}

// The layer that holds what `parts` of all bands cover, empty.
template <typename Parts>
ObjectLayer layer_around(std::span<const FragmentBand> bands, Parts parts) {
  constexpr int kNone = std::numeric_limits<int>::max();
  int x0 = kNone, x1 = -1, y0 = kNone, y1 = -1;
  for (const FragmentBand& band : bands)
    for (const auto& f : band.*parts) {
      x0 = std::min(x0, f.x), x1 = std::max(x1, f.x);
      y0 = std::min(y0, f.y), y1 = std::max(y1, f.y);
    }
  if (x1 < 0) return {};
  return {x0, y0, Image<float>(x1 - x0 + 1, y1 - y0 + 1, 4)};
}

template <typename F>
void add(const F& f, glm::vec3 value, ObjectLayer& layer) {
  float* p = layer.rgba.pixel(f.x - layer.x, f.y - layer.y);
  for (int c = 0; c < 3; ++c) p[c] += f.coverage * value[c];
  p[3] += f.coverage;
}

}  // namespace

SurfaceShading::SurfaceShading(const Material& material, const Lighting& lighting)
    : material_(&material),
      lighting_(&lighting),
      glossy_(lighting, material.exponent),
      ggx_(lighting) {}

void SurfaceShading::operator()(std::span<const Fragment> fragments, glm::vec3 eye,
                                std::span<glm::vec3> colours) const {
  for (std::size_t i = 0; i < fragments.size(); i += kBatch) {
    const std::size_t count = std::min(std::size_t{kBatch}, fragments.size() - i);
    shade_batch(fragments.subspan(i, count), eye, colours.subspan(i, count));
  }
}

void SurfaceShading::shade_batch(std::span<const Fragment> fragments, glm::vec3 eye,
                                 std::span<glm::vec3> colours) const {
  const Material& m = *material_;
  if (m.pbr) return shade_pbr(fragments, m, *lighting_, ggx_, eye, colours);
  const bool diffuse = m.diffuse != glm::vec3(0), glossy = m.glossy != glm::vec3(0);
  glm::vec3 normals[kBatch], views[kBatch], positions[kBatch], light[kBatch];
  for (std::size_t i = 0; i < fragments.size(); ++i) {
    normals[i] = fragments[i].normal, positions[i] = fragments[i].position;
    colours[i] = m.emission;
  }
  const std::span<const glm::vec3> n(normals, fragments.size()), v(views, fragments.size()),
      p(positions, fragments.size());
  const std::span<glm::vec3> values(light, fragments.size());
  if (diffuse) {
    evaluate(lighting_->irradiance, n, values);
    for (std::size_t i = 0; i < fragments.size(); ++i)
      colours[i] +=
          m.diffuse * fragments[i].color * (glm::vec3(fragments[i].share) / kPi) * light[i];
  }
  if (glossy) {
    for (std::size_t i = 0; i < fragments.size(); ++i)
      views[i] = glm::normalize(eye - positions[i]);
    glossy_(n, v, p, values);
    for (std::size_t i = 0; i < fragments.size(); ++i)
      colours[i] += glossy_share(fragments[i].share, m) * m.glossy * light[i];
  }
}

ObjectLayer shade(std::span<const FragmentBand> bands, const Material& material,
                  const Lighting& lighting, glm::vec3 eye) {
  ObjectLayer layer = layer_around(bands, &FragmentBand::object);
  const SurfaceShading shading(material, lighting);
  // Bands share no pixel.
  parallel_for(int(bands.size()), 1, [&](int begin, int end) {
    std::vector<glm::vec3> colours;
    for (int i = begin; i < end; ++i) {
      const std::vector<Fragment>& fragments = bands[std::size_t(i)].object;
      colours.resize(fragments.size());
      shading(fragments, eye, colours);
      for (std::size_t k = 0; k < fragments.size(); ++k) add(fragments[k], colours[k], layer);
    }
  });
  return layer;
}

ObjectLayer holdout_layer(std::span<const FragmentBand> bands) {
  ObjectLayer layer = layer_around(bands, &FragmentBand::holdouts);
  for (const FragmentBand& band : bands)
    for (const HoldoutFragment& f : band.holdouts) add(f, f.ratio, layer);
  return layer;
}

}  // namespace fastibl
