#include "fastibl/shading/bounce.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/irradiance.h"
#include "fastibl/scene/shadow_look_up.h"
#include "fastibl/scene/shared_formulas.h"
#include "fastibl/shading/self_shadow.h"

namespace fastibl {
namespace {

constexpr int kSamples = 2;           // of the ratio in a cell, along an edge
constexpr float kTextureTexels = 64;  // along an edge of the level of a texture that is read
// How far what an object sends to the plane reaches, times the exchange's extent: until it gives
// less than a share of the plane's own light.
constexpr int kLeastReach = 2, kMostReach = 16;
constexpr float kSeen = 0.01f;
constexpr float kFade = 0.25f;    // of the way to its end
constexpr int kMostOuter = 512;   // texels along an edge of a map for light that reaches far
constexpr int kViews = 32;        // averaged for the light that leaves a dielectric
constexpr int kRoughnesses = 16;  // for which that light is worked out, if there are many

// Share of the light from a dielectric's body that its surface lets out, over all directions.
float transmitted(const GgxAlbedo& albedo, const glm::vec4& dielectric, float roughness) {
  float sum = 0;
  for (int i = 0; i < kViews; ++i) {
    const float square = (float(i) + 0.5f) / kViews, across = std::sqrt(0.5f * (1 - square));
    const glm::vec2 kept = albedo.sample({across, across, std::sqrt(square)}, roughness);
    sum += shared::pbr_diffuse(glm::vec3(1), 0, dielectric, kept).x;
  }
  return sum / kViews;
}

// The same by roughness.
std::array<float, kRoughnesses + 1> transmitted_by_roughness(const GgxAlbedo& albedo,
                                                             const glm::vec4& dielectric) {
  std::array<float, kRoughnesses + 1> all;
  for (int i = 0; i <= kRoughnesses; ++i)
    all[std::size_t(i)] = transmitted(albedo, dielectric, float(i) / kRoughnesses);
  return all;
}

float mean_level(const SurfaceTexture& map) {
  return std::log2(std::max(float(std::max(map.width(), map.height())) / kTextureTexels, 1.0f));
}

// Share of the plane's light without the object that is left in each cell, minus 1.
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

// Where the light that an object sends to the plane comes from: from the middle of an exchange's
// cells and above the plane, in cells.
struct SentFrom {
  glm::vec2 at;
  float height;
  // What a cell gets at this distance along the plane, up to a factor.
  float at_distance(float along) const {
    const float square = along * along + height * height;
    return 1 / (square * std::sqrt(square));
  }
};

SentFrom sent_from(const glm::dvec3& weighted, double weights, const PlaneExchange& exchange,
                   const PlaneMotion& motion) {
  const float cell = 2 * exchange.extent() / float(std::max(exchange.cells(), 1));
  if (!(weights > 0) || !std::isfinite(weights)) return {glm::vec2(0), 0};
  const glm::vec3 from(weighted / weights);
  const glm::vec2 at = motion.inverse() * glm::vec2(from) - exchange.centre();
  return {at / cell, std::max(from.z, 0.0f) / cell};
}

// How many times as far as the cells reach what an object sends to the plane is seen: a power of 2.
int reach_of(const Image<float>& cells, const SentFrom& from) {
  const int n = cells.width;
  float most = 0;
  for (int i = 0; i < n; ++i)
    for (const float* cell :
         {cells.pixel(i, 0), cells.pixel(i, n - 1), cells.pixel(0, i), cells.pixel(n - 1, i)})
      most = std::max({most, cell[0], cell[1], cell[2]});
  const float border = 0.5f * float(n - 1);
  int reach = kLeastReach;
  while (reach < kMostReach &&
         most * from.at_distance(float(reach) * border) > kSeen * from.at_distance(border))
    reach *= 2;
  return reach;
}

// Extends the cells of an exchange, from the border on as a small source's light falls there. It
// fades before the end, where a ring of zeros is.
Image<float> extended(const Image<float>& cells, const SentFrom& from) {
  const int n = cells.width, reach = reach_of(cells, from), width = 2 * reach * (n / 2) + n % 2 + 2;
  const int first = (width - n) / 2;  // of the given cells
  Image<float> out(width, width, 3);
  const float middle = 0.5f * float(width - 1), border = 0.5f * float(n - 1),
              end = 0.5f * float(width - 2);
  // Strictly inside, so that rays from it cross the border.
  const glm::vec2 start = glm::clamp(from.at, -0.9f * border, 0.9f * border);
  parallel_for(width - 2, 16, [&](int begin, int stop) {
    for (int y = begin + 1; y < stop + 1; ++y)
      for (int x = 1; x < width - 1; ++x) {
        const glm::vec2 p(float(x) - middle, float(y) - middle);
        float* to = out.pixel(x, y);
        if (std::max(std::abs(p.x), std::abs(p.y)) <= border || border <= 0) {
          const bool inside = x >= first && y >= first && x < first + n && y < first + n;
          if (inside) std::copy_n(cells.pixel(x - first, y - first), 3, to);
          continue;
        }
        const float fade = std::min(1.0f, (end - glm::length(p)) / (kFade * end));
        if (!(fade > 0)) continue;
        // The border's cells on the way there.
        const glm::vec2 ray = p - start;
        const auto crossing = [&](int k) {
          return ray[k] != 0 ? ((ray[k] > 0 ? border : -border) - start[k]) / ray[k] : 1.0f;
        };
        const float part = std::min({crossing(0), crossing(1), 1.0f});
        const glm::vec2 at = glm::clamp(start + part * ray + border, 0.0f, float(n - 1));
        const glm::ivec2 low(glm::min(at, float(std::max(n - 2, 0)))),
            high = glm::min(low + 1, n - 1);
        const glm::vec2 f = at - glm::vec2(low);
        const float away = glm::length(ray),
                    fall = from.at_distance(away) / from.at_distance(part * away) * fade;
        for (int c = 0; c < 3; ++c) {
          const float above = glm::mix(cells.pixel(low.x, low.y)[c], cells.pixel(high.x, low.y)[c],
                                       f.x),
                      below = glm::mix(cells.pixel(low.x, high.y)[c],
                                       cells.pixel(high.x, high.y)[c], f.x);
          to[c] = glm::mix(above, below, f.y) * fall;
        }
      }
  });
  return out;
}

// The gain plus 1, which is 1 outside, as a map that is quick to look up.
ShadowMap map_of(const Bounce& bounce) {
  ShadowMap map;
  map.ratio = bounce.gain, map.centre = bounce.centre, map.extent = bounce.extent;
  float most = 1;
  for (float& value : map.ratio.data) most = std::max(most, value += 1);
  map.range = std::exp2(std::ceil(std::log2(std::min(most, 1e9f))));
  return map;
}

// Adds what is above 1 in `gains`, or a part of it.
FASTIBL_CLONES void add_whole(const float* __restrict gains, int count, float* __restrict ratios) {
  for (int i = 0; i < count; ++i) ratios[i] += gains[i] - 1;
}
void add_part(const glm::vec3* gains, const float* keep, int count, float* ratios) {
  for (int x = 0; x < count; ++x)
    for (int c = 0; c < 3; ++c) ratios[3 * x + c] += keep[x] * (gains[x][c] - 1);
}

// Points of a line at equal steps.
FASTIBL_CLONES void place_points(glm::vec2 first, glm::vec2 step, int count,
                                 float* __restrict out) {
  for (int x = 0; x < count; ++x)
    out[2 * x] = first.x + float(x) * step.x, out[2 * x + 1] = first.y + float(x) * step.y;
}

// Applies the look to the ratio and adds the gain, at each texel of a map. share: how far the map's
// edge lies on the way to where shadows fade; n: texels of a map that reaches there.
void add_gain(Image<float>& ratio, glm::vec2 centre, float extent, const ShadowLook& look,
              const Bounce& bounce, const ShadowLookUp& gains, float share, float n) {
  const PlaneMotion back = bounce.motion.inverse();
  const int width = ratio.width;
  const auto offset = [&](int i) { return shared::plane_offset(i, float(width)); };
  const glm::vec2 step = back * (centre + glm::vec2(extent * 2 / float(width), 0)) - back * centre;
  parallel_for(ratio.height, 16, [&](int begin, int end) {
    std::vector<glm::vec2> points(static_cast<std::size_t>(width));
    std::vector<glm::vec3> found(points.size());
    std::vector<float> keep(points.size());
    for (int y = begin; y < end; ++y) {
      float* r = ratio.row(y);
      if (look.changes())
        for (int x = 0; x < width; ++x) {
          const glm::vec3 value = look.apply({r[3 * x], r[3 * x + 1], r[3 * x + 2]});
          for (int c = 0; c < 3; ++c) r[3 * x + c] = value[c];
        }
      if (bounce.empty()) continue;
      place_points(back * (centre + extent * glm::vec2(offset(0), offset(y))), step, width,
                   &points[0].x);
      gains.sample(points, found);
      const glm::vec2 corner = share * glm::vec2(offset(0), offset(y));
      if (shared::shadow_keep(corner, n) == 1) {  // and so for all between
        add_whole(&found[0].x, 3 * width, r);
        continue;
      }
      for (int x = 0; x < width; ++x)
        keep[std::size_t(x)] = shared::shadow_keep(share * glm::vec2(offset(x), offset(y)), n);
      add_part(found.data(), keep.data(), width, r);
    }
  });
}

// Whether an object's light is seen beyond a map.
bool is_seen_beyond(const ShadowMap& plane, const Bounce& bounce) {
  const int n = bounce.gain.width;
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x) {
      const float* gain = bounce.gain.pixel(x, y);
      if (!(std::max({gain[0], gain[1], gain[2]}) > kSeen)) continue;
      const glm::vec2 at(shared::plane_offset(x, float(n)), shared::plane_offset(y, float(n)));
      const glm::vec2 off =
          glm::abs(bounce.motion * (bounce.centre + bounce.extent * at) - plane.centre);
      if (std::max(off.x, off.y) > plane.reach()) return true;
    }
  return false;
}

// Gives a map an outer one that reaches as far as the object's light is seen, if it has none.
void reach_out(const Bounce& bounce, ShadowMap& plane) {
  if (!is_seen_beyond(plane, bounce)) return;
  const glm::vec2 off = glm::abs(bounce.motion * bounce.centre - plane.centre);
  const float wanted = std::max(off.x, off.y) + bounce.extent;
  const float texel = plane.outer.empty() ? 4 * plane.extent / float(plane.ratio.width)
                                          : plane.outer_extent / float(plane.outer.width);
  const int n = int(std::clamp(std::ceil(wanted / texel), 2.0f, float(kMostOuter)));
  Image<float> outer(n, n, 3);
  parallel_for(n, 16, [&](int begin, int end) {
    std::vector<glm::vec2> points(static_cast<std::size_t>(n));
    std::vector<glm::vec3> ratios(points.size());
    for (int y = begin; y < end; ++y) {
      for (int x = 0; x < n; ++x)
        points[std::size_t(x)] =
            plane.centre + wanted * glm::vec2(shared::plane_offset(x, float(n)),
                                              shared::plane_offset(y, float(n)));
      if (plane.outer.empty())
        for (int x = 0; x < n; ++x) ratios[std::size_t(x)] = plane.sample(points[std::size_t(x)]);
      else
        plane.sample_outer(points, ratios);
      std::copy_n(&ratios[0].x, 3 * n, outer.row(y));
    }
  });
  plane.outer = std::move(outer), plane.outer_extent = wanted;
}

}  // namespace

std::vector<Exitance> vertex_exitance(const Material& material, const Mesh& mesh) {
  if (!material.pbr) {
    glm::vec3 diffuse = material.diffuse;
    if (material.exponent == 0) diffuse += material.glossy;  // follows Lambert's law, too
    std::vector<Exitance> out(mesh.vertices.size(), {diffuse, kPi * material.emission});
    for (std::size_t i = 0; i < mesh.colors.size(); ++i)
      out[i].reflectance += material.diffuse * (mesh.colors[i] - 1.0f);
    return out;
  }
  const PbrMaterial& m = *material.pbr;
  std::vector<Exitance> out;
  std::array<float, kRoughnesses + 1> by_roughness{};
  if (m.roughness_map) by_roughness = transmitted_by_roughness(*material.albedo, m.dielectric());
  float through = m.roughness_map ? 1 : transmitted(*material.albedo, m.dielectric(), m.roughness);
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    const auto read = [&](const std::shared_ptr<const SurfaceTexture>& map) {
      return map ? map->sample(mesh.uvs[i], mean_level(*map)) : glm::vec3(1);
    };
    const float metallic = m.metallic * read(m.metallic_map).x;
    if (m.roughness_map) {
      const float at = kRoughnesses * std::clamp(m.roughness * read(m.roughness_map).x, 0.0f, 1.0f);
      const int below = std::min(int(at), kRoughnesses - 1);
      through = glm::mix(by_roughness[std::size_t(below)], by_roughness[std::size_t(below) + 1],
                         at - float(below));
    }
    const glm::vec3 color = mesh.colors.empty() ? m.base_color : m.base_color * mesh.colors[i];
    out.push_back({through * (1 - metallic) * color * read(m.base_color_map),
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
  glm::dvec3 from(0);  // marker frame, weighted
  double weights = 0;
  for (std::size_t i = 0; i < count; ++i) {
    for (int c = 0; c < 3; ++c) {
      const float share = shares.empty() ? scene.visibility[i] : shares[i][c];
      if (all[i][c] > 0) bounce.shares[i][c] = std::max(lost[i][c] / all[i][c], -share);
      sent[i][c] = exitance[i].reflectance[c] * (share + bounce.shares[i][c]) * all[i][c] +
                   exitance[i].emission[c];
    }
    const double weight = double(exchange.areas()[i]) * double(sent[i].x + sent[i].y + sent[i].z);
    from += weight * (scene.marker_from_object * glm::dvec3(scene.mesh.vertices[i]));
    weights += weight;
  }
  Image<float> gain = exchange.onto_plane(sent);
  glm::vec3 inverse(0);
  for (int c = 0; c < 3; ++c)
    if (lighting.plane_irradiance[c] > kLeastIrradiance)
      inverse[c] = 1 / lighting.plane_irradiance[c];
  for (std::size_t i = 0; i < gain.data.size(); ++i) gain.data[i] *= inverse[int(i % 3)];
  bounce.gain = extended(gain, sent_from(from, weights, exchange, *motion));
  bounce.centre = exchange.centre();
  bounce.extent =
      exchange.extent() * float(bounce.gain.width) / float(std::max(exchange.cells(), 1));
  return bounce;
}

void add_shares(const Bounce& bounce, std::span<glm::vec4> shares) {
  if (!bounce.shares.empty()) add_shares(bounce.shares, shares);
}

ShadowMap plane_gain(const ShadowMap& shadow, const ShadowLook& look, const Bounce& bounce) {
  ShadowMap plane = shadow;
  if (plane.ratio.empty() || plane.no_light || (!look.changes() && bounce.empty())) return plane;
  const ShadowMap gain = map_of(bounce);
  const ShadowLookUp gains(gain);
  if (!bounce.empty()) reach_out(bounce, plane);
  const float ends = plane.reach();
  const float n = float(plane.outer.empty() ? plane.ratio.width : plane.outer.width);
  const auto add = [&](Image<float>& image, glm::vec2 centre, float extent, float share) {
    if (!image.empty()) add_gain(image, centre, extent, look, bounce, gains, share, n);
  };
  add(plane.ratio, plane.centre, plane.extent, plane.extent / ends);
  add(plane.outer, plane.centre, plane.outer_extent, 1);
  add(plane.fine, plane.fine_centre, plane.fine_extent, 0);  // lies inside: nothing fades there
  plane.range = gain.range;                                  // no ratio is above 1
  return plane;
}

}  // namespace fastibl
