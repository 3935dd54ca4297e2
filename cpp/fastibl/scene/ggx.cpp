#include "fastibl/scene/ggx.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <numbers>
#include <vector>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/isotropic_taps.h"
#include "fastibl/scene/methods.h"
#include "fastibl/scene/sampled_lobe.h"
#include "fastibl/scene/seen_lights.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

// Texture gradients of the mirror direction over slopes of ±alpha, read as an anisotropic filter
// does (EXT_texture_filter_anisotropic): N = ⌈longer / shorter⌉ look-ups along the longer one, each
// at the MIP level for longer / N.
void add_gradient_taps(glm::vec3 v, glm::vec2 alpha, int most, GgxTaps& out) {
  const glm::vec3 mirror(-v.x, -v.y, v.z);
  const glm::vec3 dx = 4 * alpha.x * glm::vec3(-v.z, 0, -v.x),
                  dy = 4 * alpha.y * glm::vec3(0, -v.z, -v.y);
  const float lx = glm::length(dx), ly = glm::length(dy);
  const glm::vec3 along = lx > ly ? dx : dy;
  const float longer = std::max({lx, ly, 1e-6f}), shorter = std::max(std::min(lx, ly), 1e-6f);
  out.count = int(std::min(std::ceil(longer / shorter), float(most)));
  for (int i = 0; i < out.count; ++i) {
    const float at = (float(i) + 0.5f) / float(out.count) - 0.5f;
    out.taps[std::size_t(i)] = {glm::normalize(mirror + at * along),
                                0.5f * longer / float(out.count), 1 / float(out.count)};
  }
}

// Sums of the lobe over all lights, without and with Schlick's edge term, times the share of each
// light that the look-ups near it do not hold. offset: see see_lights(); axes: the surface's frame.
FASTIBL_CLONES
void sum_lights(const LightArrays& lights, const float* offset, const shared::GgxLobe& lobe,
                const float* axes, const GgxTaps& taps, const float* level, float* front,
                float* edge) {
  float x[kMaxLights], y[kMaxLights], z[kMaxLights], value[kMaxLights], edge_value[kMaxLights];
  SeenLights seen;
  see_lights(lights, offset, seen);
  for (int i = 0; i < kMaxLights; ++i) {
    x[i] = axes[0] * seen.x[i] + axes[1] * seen.y[i] + axes[2] * seen.z[i];
    y[i] = axes[3] * seen.x[i] + axes[4] * seen.y[i] + axes[5] * seen.z[i];
    z[i] = axes[6] * seen.x[i] + axes[7] * seen.y[i] + axes[8] * seen.z[i];
  }
  LightsLeft sums;
  for (int k = 0; k < taps.count; ++k) {
    const GgxTap& tap = taps.taps[std::size_t(k)];
    add_look_up(lights, x, y, z, seen.variance, tap.direction, tap.width * tap.width, level[k],
                tap.weight, sums);
  }
  for (int i = 0; i < kMaxLights; ++i) {
    const glm::vec3 l(x[i], y[i], z[i]);
    value[i] = sums.left[i] / sums.around[i] * seen.gain[i] *
               shared::ggx_light(lobe.view, lobe.alpha, lobe.view_size, l, seen.variance[i]);
    edge_value[i] = value[i] * shared::ggx_edge(l, lobe.view);
    value[i] -= edge_value[i];
  }
  sum_flux(lights, value, front);
  sum_flux(lights, edge_value, edge);
}

glm::vec3 unit_or(glm::vec3 v, glm::vec3 otherwise) {
  const float length = glm::length(v);
  return length > 1e-6f && std::isfinite(length) ? v / length : otherwise;
}

// Sums over look-ups.
struct LightParts {
  glm::vec3 front{0}, edge{0};
  float front_weight = 0, edge_weight = 0;

  void add(glm::vec3 radiance, float weight, float edge_part) {
    const float e = weight * edge_part, f = weight - e;
    front += f * radiance, edge += e * radiance;
    front_weight += f, edge_weight += e;
  }
  GgxLight averages() const {
    return {front / front_weight, edge / edge_weight, edge_weight / (front_weight + edge_weight)};
  }
};

// A place on the unit disc, and its share of the area.
struct DiscPlace {
  double x, y, weight;
};

// r = sin ψ smooths integrands that fall to 0 like a root at the rim; a turn's weights sin 2ψ are
// divided by their sum. Turns have other radii (golden section): seen along the normal, the horizon
// cuts the disc along a circle, which of equal rings would take all of one or nothing.
std::vector<DiscPlace> disc_places(int steps, int turns) {
  std::vector<DiscPlace> places;
  for (int k = 0; k < turns; ++k) {
    const double angle = (k + 0.5) / turns * 2 * std::numbers::pi;
    const double shift = std::fmod(0.5 + k * (std::numbers::phi - 1), 1);
    const std::size_t first = places.size();
    double sum = 0;
    for (int i = 0; i < steps; ++i) {
      const double psi = (i + shift) / steps * std::numbers::pi / 2, r = std::sin(psi);
      places.push_back({r * std::cos(angle), r * std::sin(angle), std::sin(2 * psi)});
      sum += places.back().weight;
    }
    for (std::size_t i = first; i < places.size(); ++i) places[i].weight /= sum * turns;
  }
  return places;
}

GgxLight sampled_ggx(const SeenMap& map, const SurfaceFrame& frame, glm::vec3 view, glm::vec2 alpha,
                     int taps) {
  // The view as the lobe uses it: above the horizon.
  const float up = glm::dot(view, frame.normal);
  const glm::vec3 lifted = glm::normalize(view + (std::max(up, 1e-3f) - up) * frame.normal);
  LightParts parts;
  for (const LobeTap& tap : ggx_lobe_taps(map, frame, view, alpha, taps))
    parts.add(tap.radiance, tap.weight, shared::ggx_edge(tap.direction, lifted));
  return parts.averages();
}

}  // namespace

std::string_view name(GgxMethod method) {
  switch (method) {
    case GgxMethod::taps:
      return "taps";
    case GgxMethod::gradient:
      return "gradient";
    case GgxMethod::sampled:
      return "sampled";
  }
  return "";
}
GgxMethod ggx_method(std::string_view text) { return method_named(text, kGgxMethods, "ggx"); }

glm::vec2 ggx_alpha(float roughness, float anisotropy) {
  const float across = roughness * roughness;
  const float along = across + (1 - across) * anisotropy * anisotropy;
  return glm::clamp(glm::vec2(along, across), kSmallestAlpha, 1.0f);
}

GgxTaps ggx_taps(glm::vec3 view, glm::vec2 alpha, const GgxOptions& options) {
  GgxTaps out;
  const int count = std::clamp(options.taps, 1, kMostGgxTaps);
  const shared::GgxLobe lobe = shared::ggx_lobe(view, alpha);
  std::array<glm::vec4, kMostGgxTaps> parts;
  glm::vec4 sum(0);
  float begin = -1;
  for (int k = 0; k < count; ++k) {
    const float end = shared::ggx_begin(k + 1, count);
    parts[std::size_t(k)] = shared::ggx_part(lobe, begin, end);
    sum += parts[std::size_t(k)];
    begin = end;
  }
  out.albedo = sum.w;
  if (options.method == GgxMethod::gradient) {
    add_gradient_taps(lobe.view, alpha, count, out);
    return out;
  }
  const glm::vec3 centre = shared::ggx_centre(sum, lobe.view);
  if (!(sum.w > 1e-12f)) {
    out.count = 1;
    out.taps[0] = {centre, std::max(alpha.x, alpha.y), 1};
    return out;
  }
  out.count = count;
  for (std::size_t k = 0; k < std::size_t(count); ++k) {
    const glm::vec4 tap = shared::ggx_tap(lobe, parts[k], centre);
    out.taps[k] = {glm::vec3(tap), tap.w, parts[k].w / sum.w};
  }
  return out;
}

SurfaceFrame frame_around(glm::vec3 normal, glm::vec3 tangent) {
  glm::vec3 across = glm::cross(normal, unit_or(tangent, glm::vec3(0)));
  if (!(glm::dot(across, across) > 1e-8f))
    across =
        glm::cross(normal, std::abs(normal.x) < 0.7f ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0));
  const glm::vec3 bitangent = unit_or(across, glm::vec3(0, 1, 0));
  return {glm::cross(bitangent, normal), bitangent, normal};
}

GgxShading::GgxShading(const Lighting& lighting) : lighting_(&lighting) {
  const GlossyChain* chain = lighting.chain.get();
  if (chain && !chain->lights.empty()) lights_ = arrays_of(lighting);
  if (lighting.box) walls_.emplace(*lighting.box, lighting.near_lights.centre);
}

GgxLight GgxShading::operator()(const SurfaceFrame& frame, glm::vec3 view, glm::vec2 alpha,
                                const GgxOptions& options, const glm::vec3* position) const {
  check(lighting_->radiance != nullptr, "the lighting has no map");
  for (int k = 0; k < 2; ++k) alpha[k] = std::min(std::max(kSmallestAlpha, alpha[k]), 1.0f);
  if (options.method == GgxMethod::sampled)
    return sampled_ggx({*lighting_, walls_, position}, frame, view, alpha, options.taps);
  const glm::vec3 local(glm::dot(view, frame.tangent), glm::dot(view, frame.bitangent),
                        glm::dot(view, frame.normal));
  const shared::GgxLobe lobe = shared::ggx_lobe(local, alpha);
  const bool round =
      alpha.x == alpha.y && options.method == GgxMethod::taps && options.taps == kGgxTaps;
  const GgxTaps taps = round ? IsotropicTaps::table().at(local, std::sqrt(alpha.x))
                             : ggx_taps(local, alpha, options);
  const CubeMap& map = *lighting_->radiance;
  const GlossyChain* chain = lighting_->chain.get();
  const glm::vec3 offset = position ? *position - lighting_->near_lights.centre : glm::vec3(0);
  const float* beside = position && lights_.any_near ? &offset.x : nullptr;
  SeenLights seen;
  if (beside) see_lights(lights_, beside, seen);
  float levels[kMostGgxTaps];
  LightParts parts;
  for (std::size_t k = 0; k < std::size_t(taps.count); ++k) {
    const GgxTap& tap = taps.taps[k];
    const glm::vec3 d = tap.direction.x * frame.tangent + tap.direction.y * frame.bitangent +
                        tap.direction.z * frame.normal;
    ChainLookUp at{
        position && walls_ ? walls_->direction(d, offset) : d,
        chain ? chain->level_of(tap.width) : shared::blur_level(float(map.size()), tap.width)};
    if (beside)
      at = moved(lights_, seen, d, glm::normalize(at.direction), at.level, tap.width * tap.width);
    levels[k] = at.level;
    parts.add(chain ? chain->sample(at.direction, at.level) : map.sample(at.direction, at.level),
              tap.weight, shared::ggx_edge(tap.direction, lobe.view));
  }
  GgxLight light = parts.averages();
  if (lights_.count == 0) return light;
  const float axes[9] = {frame.tangent.x,   frame.tangent.y,   frame.tangent.z,
                         frame.bitangent.x, frame.bitangent.y, frame.bitangent.z,
                         frame.normal.x,    frame.normal.y,    frame.normal.z};
  sum_lights(lights_, beside, lobe, axes, taps, levels, &light.front_lights.x,
             &light.edge_lights.x);
  light.albedo = std::max(taps.albedo, 1e-4f);
  return light;
}

glm::dvec2 integrate_ggx_albedo(glm::dvec3 v, glm::dvec2 alpha) {
  // G2/G1 averaged over midpoints of visible normals: Heitz 2018, Sampling the GGX distribution of
  // visible normals. With this distribution the integrand is flat, also at grazing views.
  static const std::vector<DiscPlace> places = disc_places(96, 32);
  v = glm::normalize(glm::dvec3(v.x, v.y, std::max(v.z, 1e-6)));
  const glm::dvec3 stretch(alpha, 1);
  const double view_size = glm::length(stretch * v);
  const glm::dvec3 up = stretch * v / view_size;
  const double flat = std::hypot(up.x, up.y);
  const glm::dvec3 side = flat > 0 ? glm::dvec3(-up.y, up.x, 0) / flat : glm::dvec3(1, 0, 0);
  const glm::dvec3 other = glm::cross(up, side);
  const double share = 0.5 * (1 + up.z);
  glm::dvec2 sum(0);
  for (const auto& [x, across, weight] : places) {
    const double rim = std::sqrt(1 - x * x);
    const double y = (1 - share) * rim + share * across;
    const double z = std::sqrt(std::max(0.0, rim * rim - y * y));
    const glm::dvec3 h = glm::normalize(stretch * (x * side + y * other + z * up));
    const double vh = glm::dot(v, h);
    const glm::dvec3 l = 2 * vh * h - v;
    if (!(l.z > 0)) continue;
    // G2/G1 = (1 + Λ_v) / (1 + Λ_v + Λ_l) with Λ = (|A w| / w_z − 1) / 2.
    const double a = view_size / v.z, b = glm::length(stretch * l) / l.z;
    const double g = (1 + a) / (a + b), rest = std::pow(std::clamp(1 - vh, 0.0, 1.0), 5);
    sum += weight * g * glm::dvec2(1 - rest, rest);
  }
  return sum;
}

Image<float> dfg_table(int size) {
  check(size >= 1 && size <= 1024, "the size of a DFG table must be 1 to 1024, got ", size);
  Image<float> table(size, size, 2);
  parallel_for(size, 1, [&](int begin, int end) {
    for (int row = begin; row < end; ++row) {
      const glm::dvec2 alpha(ggx_alpha((float(row) + 0.5f) / float(size), 0));
      for (int column = 0; column < size; ++column) {
        const double cosine = (column + 0.5) / size;
        const glm::dvec2 albedo =
            integrate_ggx_albedo({std::sqrt(1 - cosine * cosine), 0, cosine}, alpha);
        table.pixel(column, row)[0] = float(albedo.x);
        table.pixel(column, row)[1] = float(albedo.y);
      }
    }
  });
  return table;
}

GgxAlbedo::GgxAlbedo(float anisotropy) : azimuths_(anisotropy > 0 ? kAzimuths : 1) {
  values_.reserve(std::size_t(azimuths_) * kRoughnesses * kCosines);
  for (int a = 0; a < azimuths_; ++a)
    for (int r = 0; r < kRoughnesses; ++r)
      for (int c = 0; c < kCosines; ++c) {
        const double turn = azimuths_ > 1 ? a * std::numbers::pi / 2 / (azimuths_ - 1) : 0;
        const float roughness = std::sqrt(kSmallestAlpha) +
                                (1 - std::sqrt(kSmallestAlpha)) * float(r) / (kRoughnesses - 1);
        const double root = double(c) / (kCosines - 1), cosine = root * root;
        const double sine = std::sqrt(1 - cosine * cosine);
        values_.emplace_back(
            integrate_ggx_albedo({sine * std::cos(turn), sine * std::sin(turn), cosine},
                                 glm::dvec2(ggx_alpha(roughness, anisotropy))));
      }
}

std::shared_ptr<const GgxAlbedo> GgxAlbedo::of(float anisotropy) {
  static std::mutex guard;
  static std::vector<std::pair<float, std::weak_ptr<const GgxAlbedo>>> made;
  const std::scoped_lock lock(guard);
  std::erase_if(made, [](const auto& entry) { return entry.second.expired(); });
  for (const auto& [strength, table] : made)
    if (strength == anisotropy)
      if (auto kept = table.lock()) return kept;
  auto table = std::make_shared<const GgxAlbedo>(anisotropy);
  made.emplace_back(anisotropy, table);
  return table;
}

glm::vec2 GgxAlbedo::sample(glm::vec3 view, float roughness) const {
  const glm::vec3 p = shared::ggx_albedo_coordinate(view, roughness) *
                      glm::vec3(kRoughnesses - 1, kCosines - 1, azimuths_ - 1);
  const int r = std::min(int(p.x), kRoughnesses - 2), c = std::min(int(p.y), kCosines - 2);
  const float fr = p.x - float(r), fc = p.y - float(c);
  const auto slice = [&](int a) {
    const glm::vec2* row =
        &values_[(std::size_t(a) * kRoughnesses + std::size_t(r)) * kCosines + std::size_t(c)];
    const glm::vec2 low = row[0] + fc * (row[1] - row[0]);
    const glm::vec2 high = row[kCosines] + fc * (row[kCosines + 1] - row[kCosines]);
    return low + fr * (high - low);
  };
  if (azimuths_ == 1) return slice(0);
  const int a = std::min(int(p.z), azimuths_ - 2);
  const glm::vec2 first = slice(a);
  return first + (p.z - float(a)) * (slice(a + 1) - first);
}

}  // namespace fastibl
