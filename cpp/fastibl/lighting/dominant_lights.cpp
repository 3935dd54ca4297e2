#include "fastibl/lighting/dominant_lights.h"

#include <algorithm>
#include <array>
#include <bit>
#include <utility>

#include "fastibl/core/check.h"
#include "fastibl/lighting/find_lights.h"
#include "fastibl/lighting/fit_glossy_chain.h"

namespace fastibl {
namespace {

// Whether the lighting looked for lights itself.
bool own_lights(const Lighting& lighting) {
  return lighting.chain && (lighting.chain->most_lights > 0 || !lighting.chain->lights.empty());
}

// What the lights take of the working level.
std::vector<TakenTexel> taken_texels(const Lighting& lighting, const CubeLevel& source) {
  std::vector<TakenTexel> taken;
  if (own_lights(lighting)) {
    taken = lighting.chain->taken;
  } else {
    for (const FoundLight& light : find_lights(*lighting.radiance, source))
      taken.insert(taken.end(), light.parts.begin(), light.parts.end());
  }
  return taken;
}

// A texel of the finer map within a texel of the coarser one.
struct Piece {
  glm::vec3* radiance;
  double angle;  // steradians
  double mean() const { return (double(radiance->x) + radiance->y + radiance->z) / 3; }
};

// The c at which the sum of angle · min(mean, c) is `light`.
double ceiling(std::vector<Piece>& pieces, double light) {
  std::ranges::sort(pieces, {}, &Piece::mean);
  double below = 0, above = 0;
  for (const Piece& piece : pieces) above += piece.angle;
  for (const Piece& piece : pieces) {
    if (below + piece.mean() * above >= light) break;  // the first one that is cut
    below += piece.mean() * piece.angle;
    above -= piece.angle;
  }
  return above > 0 ? (light - below) / above : pieces.back().mean();
}

// Cuts pieces so that they hold what is left of the texel that they make up: the brightest first.
void cut(std::vector<Piece>& pieces, const glm::dvec3& left) {
  double angle = 0;
  for (const Piece& piece : pieces) angle += piece.angle;
  const glm::dvec3 kept = angle * left;
  const double most = ceiling(pieces, (kept.x + kept.y + kept.z) / 3);
  std::vector<glm::dvec3> values;
  glm::dvec3 held(0);
  for (const Piece& piece : pieces) {
    const double share = piece.mean() > most ? most / piece.mean() : 1;
    values.push_back(share * glm::dvec3(*piece.radiance));
    held += piece.angle * values.back();
  }
  // The pieces differ in colour: each channel keeps its own light.
  glm::dvec3 scale(0);
  for (int c = 0; c < 3; ++c)
    if (held[c] > 0) scale[c] = kept[c] / held[c];
  for (std::size_t i = 0; i < pieces.size(); ++i)
    *pieces[i].radiance = glm::vec3(scale * values[i]);
}

}  // namespace

std::vector<DominantLight> dominant_lights(const Lighting& lighting) {
  check(lighting.radiance != nullptr, "the lighting has no map");
  std::vector<DominantLight> lights;
  const NearLights& near_lights = lighting.near_lights;
  const auto add = [&](const Light& light) {
    const float inverse = near_lights.inverse_distance(light.direction);
    lights.push_back({light, near_lights.position(light.direction, inverse)});
  };
  if (own_lights(lighting)) {
    for (const Light& light : lighting.chain->lights) add(light);
  } else {
    const CubeLevel source = working_level(*lighting.radiance);
    for (const FoundLight& found : find_lights(*lighting.radiance, source)) add(found.light);
  }
  return lights;
}

CubeMap without_lights(const Lighting& lighting) {
  check(lighting.radiance != nullptr, "the lighting has no map");
  const CubeMap& map = *lighting.radiance;
  const CubeLevel source = working_level(map);
  const std::vector<TakenTexel> taken = taken_texels(lighting, source);
  const CubeLevel left = without_lights(source, taken);
  const int count = map.size() / left.size();
  const bool finer =
      count > 1 && count * left.size() == map.size() && std::has_single_bit(unsigned(count));
  CubeMap result(finer ? map.size() : left.size());
  result.base() = finer ? map.level(0) : left;
  if (finer) {
    const std::vector<double> angles = texel_solid_angles(map.size());
    std::vector<std::array<int, 3>> places;
    for (const TakenTexel& texel : taken) places.push_back({texel.face, texel.y, texel.x});
    std::ranges::sort(places);
    places.erase(std::unique(places.begin(), places.end()), places.end());
    std::vector<Piece> pieces;
    for (const auto& [face, row, column] : places) {
      pieces.clear();
      for (int y = row * count; y < (row + 1) * count; ++y)
        for (int x = column * count; x < (column + 1) * count; ++x)
          pieces.push_back({&result.base().texel(face, x, y),
                            angles[std::size_t(y) * std::size_t(map.size()) + std::size_t(x)]});
      cut(pieces, glm::dvec3(left.texel(face, column, row)));
    }
  }
  result.update();
  return result;
}

}  // namespace fastibl
