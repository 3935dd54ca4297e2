#include "fastibl/scene/glossy_chain.h"

#include <algorithm>
#include <cmath>

namespace fastibl {

float GlossyChain::own_width() const {
  return std::min(0.25f * kPi / float(map->size()), 0.5f * kFinestWidth);
}

float GlossyChain::level_of(float width) const {
  if (width >= kFinestWidth)
    return std::min(1 + std::log2(width / kFinestWidth), float(kLevelCount - 1));
  const float own = own_width();
  return width > own ? std::log2(width / own) / std::log2(kFinestWidth / own) : 0.0f;
}

glm::vec3 GlossyChain::sample(glm::vec3 direction, float lobe_level) const {
  const float top = float(kLevelCount - 1);
  const float clamped = lobe_level > 0 ? (lobe_level < top ? lobe_level : top) : 0.0f;  // NaN: 0
  const int k = int(clamped);
  const float f = clamped - float(k);
  const glm::vec3 fine = level(k).sample(direction);
  if (f == 0) return fine;
  return fine + f * (level(k + 1).sample(direction) - fine);
}

float GlossyChain::light_share(std::size_t i, float lobe_level) const {
  const float clamped = std::clamp(lobe_level, 0.0f, float(kLevelCount - 1));
  const int k = std::min(int(clamped), kLevelCount - 2);
  const float fine = k == 0 ? 0.0f : light_taken(k, light_levels[i]);
  return fine + (clamped - float(k)) * (light_taken(k + 1, light_levels[i]) - fine);
}

}  // namespace fastibl
