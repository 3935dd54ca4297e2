#include "fastibl/shading/bounce.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/scene/irradiance.h"
#include "fastibl/scene/shared_formulas.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {
namespace {

constexpr int kSamples = 2;           // of the ratio in a cell, along an edge
constexpr float kTextureTexels = 64;  // along an edge of the level of a texture that is read

float mean_level(const SurfaceTexture& map) {
  return std::log2(std::max(float(std::max(map.width(), map.height())) / kTextureTexels, 1.0f));
}

// Share of what lights the plane without the object that is left in each cell, minus 1.
Image<float> mean_change(const ShadowMap& shadow, const PlaneExchange& exchange,
                         const PlaneMotion& motion) {
  const int n = exchange.cells(), fine = n * kSamples;
  Image<float> change(n, n, 3);
  const auto along = [&](int i) {
    return exchange.extent() * shared::plane_offset(i, float(fine));
  };
  parallel_for(n, 2, [&](int begin, int end) {
    std::vector<glm::vec2> points(static_cast<std::size_t>(fine));
    std::vector<glm::vec3> ratios(points.size());
    for (int y = begin * kSamples; y < end * kSamples; ++y) {
      for (int x = 0; x < fine; ++x)
        points[std::size_t(x)] = motion * (exchange.centre() + glm::vec2(along(x), along(y)));
      shadow.sample(points, ratios);
      for (int x = 0; x < fine; ++x)
        for (int c = 0; c < 3; ++c)
          change.pixel(x / kSamples, y / kSamples)[c] +=
              (ratios[std::size_t(x)][c] - 1) / (kSamples * kSamples);
    }
  });
  return change;
}

// With a ring of zeros around.
Image<float> ringed(const Image<float>& image) {
  Image<float> out(image.width + 2, image.height + 2, image.channels);
  for (int y = 0; y < image.height; ++y)
    std::copy_n(image.row(y), image.width * image.channels, out.pixel(1, y + 1));
  return out;
}

// Bilinear; 0 outside.
glm::vec3 gain_at(const Bounce& bounce, glm::vec2 point) {
  const int n = bounce.gain.width;
  const glm::vec2 p =
      (point - bounce.centre) * (0.5f * float(n) / bounce.extent) + (0.5f * float(n) - 0.5f);
  if (!(p.x > 0 && p.y > 0 && p.x < float(n - 1) && p.y < float(n - 1))) return glm::vec3(0);
  const int x = int(p.x), y = int(p.y);
  const float fx = p.x - float(x), fy = p.y - float(y);
  const float *a = bounce.gain.pixel(x, y), *b = bounce.gain.pixel(x, y + 1);
  glm::vec3 out;
  for (int c = 0; c < 3; ++c) {
    const float left = a[c] + fy * (b[c] - a[c]), right = a[c + 3] + fy * (b[c + 3] - a[c + 3]);
    out[c] = left + fx * (right - left);
  }
  return out;
}

// The ratio as the look has it, and the gain, at each texel of a map. keep(p): of the gain, p in
// half edges from the centre.
template <typename Keep>
void add_gain(Image<float>& ratio, glm::vec2 centre, float extent, const ShadowLook& look,
              const Bounce& bounce, Keep&& keep) {
  const PlaneMotion back = bounce.motion.inverse();
  parallel_for(ratio.height, 16, [&](int begin, int end) {
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < ratio.width; ++x) {
        float* r = ratio.pixel(x, y);
        const glm::vec2 p(shared::plane_offset(x, float(ratio.width)),
                          shared::plane_offset(y, float(ratio.width)));
        const glm::vec3 gain =
            bounce.empty() ? glm::vec3(0) : gain_at(bounce, back * (centre + extent * p));
        if (gain == glm::vec3(0) && !look.changes()) continue;
        glm::vec3 value(r[0], r[1], r[2]);
        if (look.changes()) value = look.apply(value);
        if (gain != glm::vec3(0)) value += keep(p) * gain;
        for (int c = 0; c < 3; ++c) r[c] = value[c];
      }
  });
}

}  // namespace

std::vector<Exitance> vertex_exitance(const Material& material, const Mesh& mesh) {
  if (!material.pbr) {
    glm::vec3 diffuse = material.diffuse;
    if (material.exponent == 0) diffuse += material.glossy;  // Lambert's law, too
    return std::vector<Exitance>(mesh.vertices.size(), {diffuse, kPi * material.emission});
  }
  const PbrMaterial& m = *material.pbr;
  std::vector<Exitance> out;
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    const auto read = [&](const std::shared_ptr<const SurfaceTexture>& map) {
      return map ? map->sample(mesh.uvs[i], mean_level(*map)) : glm::vec3(1);
    };
    const float metallic = m.metallic * read(m.metallic_map).x;
    out.push_back({(1 - metallic) * m.base_color * read(m.base_color_map),
                   kPi * m.emission * read(m.emission_map)});
  }
  return out;
}

Bounce find_bounce(const PlaneExchange& exchange, const Scene& scene, const Lighting& lighting,
                   const ShadowMap& shadow, std::span<const glm::vec4> shares) {
  const std::size_t count = scene.mesh.vertices.size();
  check(exchange.vertex_count() == count && (shares.empty() || shares.size() % count == 0),
        "the exchange and the shares must be of the mesh's ", count, " vertices, got ",
        exchange.vertex_count(), " and ", shares.size());
  Bounce bounce;
  const std::optional<PlaneMotion> motion = exchange.motion(scene.marker_from_object);
  if (exchange.empty() || !motion || shadow.no_light || shadow.ratio.empty()) return bounce;
  bounce.motion = *motion;

  std::vector<glm::vec3> normals(count), all(count);
  const glm::mat3 marker_from_object(scene.marker_from_object.rotation);
  for (std::size_t i = 0; i < count; ++i) normals[i] = marker_from_object * scene.normals[i];
  evaluate(lighting.irradiance, normals, all);
  // A diffuse plane of radiance L lights what faces it with π L, which is also what it sends out.
  const glm::vec3 plane = evaluate(lighting.irradiance, {0, 0, -1});
  Image<float> change = mean_change(shadow, exchange, *motion);
  for (std::size_t i = 0; i < change.data.size(); ++i) change.data[i] *= plane[int(i % 3)];
  const std::vector<glm::vec3> lost = exchange.onto_object(change);

  std::vector<Exitance> exitance = vertex_exitance(scene.material, scene.mesh);
  std::vector<glm::vec3> sent(count);
  bounce.shares.assign(count, glm::vec3(0));
  for (std::size_t i = 0; i < count; ++i)
    for (int c = 0; c < 3; ++c) {
      const float share = shares.empty() ? scene.visibility[i] : shares[i][c];
      if (all[i][c] > 0) bounce.shares[i][c] = std::max(lost[i][c] / all[i][c], -share);
      sent[i][c] = exitance[i].reflectance[c] * (share + bounce.shares[i][c]) * all[i][c] +
                   exitance[i].emission[c];
    }
  Image<float> gain = exchange.onto_plane(sent);
  glm::vec3 inverse(0);
  for (int c = 0; c < 3; ++c)  // the inverse of a smaller one is not finite
    if (lighting.plane_irradiance[c] > 1e-30f) inverse[c] = 1 / lighting.plane_irradiance[c];
  for (std::size_t i = 0; i < gain.data.size(); ++i) gain.data[i] *= inverse[int(i % 3)];
  bounce.gain = ringed(gain);
  bounce.centre = exchange.centre();
  bounce.extent =
      exchange.extent() * float(bounce.gain.width) / float(std::max(exchange.cells(), 1));
  return bounce;
}

void add_shares(const Bounce& bounce, std::span<glm::vec4> shares) {
  if (!bounce.shares.empty()) add_shares(bounce.shares, shares);
}

namespace {

// The power of two that holds all texels.
float range_of(const ShadowMap& plane) {
  float most = 1;
  for (const Image<float>* image : {&plane.ratio, &plane.outer, &plane.fine})
    for (const float value : image->data) most = std::max(most, value);
  return std::exp2(std::ceil(std::log2(std::min(most, 1e9f))));
}

}  // namespace

ShadowMap plane_gain(const ShadowMap& shadow, const ShadowLook& look, const Bounce& bounce) {
  ShadowMap plane = shadow;
  if (plane.ratio.empty() || plane.no_light || (!look.changes() && bounce.empty())) return plane;
  const float ends = plane.reach();
  const auto keep = [&](float extent, const Image<float>& last) {
    return [=, n = float(last.width)](glm::vec2 p) {
      return shared::shadow_keep(p * (extent / ends), n);
    };
  };
  const Image<float>& last = plane.outer.empty() ? shadow.ratio : shadow.outer;
  add_gain(plane.ratio, plane.centre, plane.extent, look, bounce, keep(plane.extent, last));
  if (!plane.outer.empty())
    add_gain(plane.outer, plane.centre, plane.outer_extent, look, bounce,
             keep(plane.outer_extent, last));
  if (!plane.fine.empty())  // lies inside: nothing fades there
    add_gain(plane.fine, plane.fine_centre, plane.fine_extent, look, bounce,
             [](glm::vec2) { return 1.0f; });
  plane.range = range_of(plane);
  return plane;
}

}  // namespace fastibl
