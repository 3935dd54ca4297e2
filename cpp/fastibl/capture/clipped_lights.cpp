#include "fastibl/capture/clipped_lights.h"

#include <algorithm>

#include "fastibl/core/disjoint_sets.h"
#include "fastibl/scene/tile_cone.h"

namespace fastibl {
namespace {

constexpr float kMoved = 0.02f;  // share by which factors move before maps show it

double sum(const glm::dvec3& v) { return v.x + v.y + v.z; }

// Whether the factors of texels do that are like their light.
bool moved(const LightBoost& from, const LightBoost& to) {
  const auto moves = [&](const glm::vec3& before, const glm::vec3& after) {
    const glm::vec3 first = 1.0f + from.cosine * before, then = 1.0f + to.cosine * after,
                    difference = glm::abs(then - first), limit = kMoved * first;
    return difference.x > limit.x || difference.y > limit.y || difference.z > limit.z;
  };
  return moves(from.whole, to.whole) || moves(from.part, to.part);
}

// a / b by channel, 0 where b is.
glm::dvec3 ratio(const glm::dvec3& a, const glm::dvec3& b) {
  glm::dvec3 out(0);
  for (int c = 0; c < 3; ++c)
    if (b[c] > 0) out[c] = a[c] / b[c];
  return out;
}

}  // namespace

std::vector<ClippedLights::TileBounds> ClippedLights::bounds_of(const MapTiles& map) const {
  std::vector<TileBounds> bounds;
  std::vector<int> at(std::size_t(map.grid().count()), -1);  // by tile
  const TileGeometry& geometry = map.geometry;
  for (int tile = 0; tile < map.grid().count(); ++tile) {
    if (!map.has_bounds(tile)) continue;
    at[std::size_t(tile)] = int(bounds.size());
    bounds.push_back({tile,
                      sum_bounds(map.state, geometry.start(tile), geometry.texels(tile),
                                 geometry.angles(tile), geometry.projected(tile)),
                      0});
  }
  DisjointSets lights(bounds.size());
  for (std::size_t i = 0; i < bounds.size(); ++i)
    for (const int corner : {0, 2, 6, 8})
      for (const int other : meetings_.at(bounds[i].tile, corner)) {
        const int j = at[std::size_t(other)];
        if (j >= 0) lights.join(int(i), j);
      }
  std::vector<double> flux(bounds.size()), plane(bounds.size());
  for (std::size_t i = 0; i < bounds.size(); ++i) {
    const auto r = std::size_t(lights.lowest(int(i)));
    flux[r] += sum(bounds[i].light.flux.all()), plane[r] += sum(bounds[i].light.plane.all());
  }
  for (std::size_t i = 0; i < bounds.size(); ++i) {
    const auto r = std::size_t(lights.lowest(int(i)));
    bounds[i].cosine = flux[r] > 0 ? plane[r] / flux[r] : 0;
  }
  return bounds;
}

std::vector<int> ClippedLights::weigh(const MissingLight& missing, double most, MapTiles& map) {
  const std::vector<TileBounds> bounds = bounds_of(map);
  any_ = !bounds.empty();
  // What slopes of 1 add: to the irradiance of the plane, and to the flux.
  BoundSum irradiance, flux;
  glm::dvec3 towards(0);
  double cosine = 0;  // the largest
  weighed_ = 0;
  for (const auto& [tile, light, of_light] : bounds) {
    // sent: by texels; facing: that times their own cosines.
    const auto add = [c = of_light](const BoundSum& sent, const BoundSum& facing, BoundSum& out) {
      const auto mix = [c](const glm::dvec3& s, const glm::dvec3& f) {
        return c * s + kOwnCosine * (f - c * s);
      };
      out.whole += mix(sent.whole, facing.whole), out.part += mix(sent.part, facing.part);
      out.rest += mix(sent.rest, facing.rest);
    };
    add(light.plane, light.facing, irradiance), add(light.flux, light.plane, flux);
    const double sent = sum(light.flux.whole + light.flux.part);
    weighed_ += sent, towards += sent * glm::dvec3(tile_cone(map.grid(), tile).middle);
    const double own = sum(light.plane.all()) / std::max(sum(light.flux.all()), 1e-300);
    cosine = std::max(cosine, of_light + kOwnCosine * (own - of_light));
  }
  spread_ = weighed_ > 0 ? std::max(0.0, 1 - glm::length(towards) / weighed_) : 0;
  const glm::dvec3 found = glm::max(missing.irradiance, 0.0), square = found * found;
  const glm::dvec3 excess =
      missing.chance * found * ratio(square, square + missing.deviation * missing.deviation);
  const double steepest = cosine > 0 ? (most - 1) / cosine : 0;
  const glm::dvec3 whole = glm::min(ratio(excess, irradiance.whole), steepest),
                   left = glm::max(excess - whole * irradiance.whole, 0.0),
                   part = glm::min(ratio(left, irradiance.part), steepest);
  added_ = whole * irradiance.whole + part * irradiance.part;
  boosted_ = glm::dot(whole, flux.whole) + glm::dot(part, flux.part);
  const glm::dvec3 open = glm::max(missing.irradiance + missing.deviation - added_, 0.0);
  doubt_ = glm::dot(ratio(open, irradiance.all()), flux.all());
  std::vector<LightBoost> boosts(map.boosts.size());
  for (const TileBounds& b : bounds)
    boosts[std::size_t(b.tile)] = {glm::vec3(whole), glm::vec3(part), float(b.cosine)};
  std::vector<int> shown;
  for (std::size_t i = 0; i < boosts.size(); ++i) {
    if (!moved(map.boosts[i], boosts[i])) continue;
    map.boosts[i] = boosts[i];
    if (map.was_seen(int(i))) shown.push_back(int(i));
  }
  return shown;
}

void ClippedLights::forget(MapTiles& map) {
  std::fill(map.boosts.begin(), map.boosts.end(), LightBoost{});
  any_ = false, added_ = glm::dvec3(0), weighed_ = boosted_ = doubt_ = spread_ = 0;
}

}  // namespace fastibl
