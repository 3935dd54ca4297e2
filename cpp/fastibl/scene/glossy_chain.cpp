#include "fastibl/scene/glossy_chain.h"

#include <algorithm>

#include "fastibl/scene/shared_formulas.h"

namespace fastibl {

float GlossyChain::own_width() const { return shared::own_lobe_width(float(map->size())); }

float GlossyChain::level_of(float width) const {
  return shared::lobe_level(width, float(map->size()));
}

glm::vec3 GlossyChain::sample(glm::vec3 direction, float lobe_level) const {
  const float top = float(kLevelCount - 1);
  const float clamped = lobe_level > 0 ? (lobe_level < top ? lobe_level : top) : 0.0f;  // NaN: 0
  const int k = int(clamped);
  const float f = clamped - float(k);
  const FacePoint at = face_point(direction);
  const glm::vec3 fine = level(k).sample(at);
  if (f == 0) return fine;
  return fine + f * (level(k + 1).sample(at) - fine);
}

float GlossyChain::light_share(std::size_t i, float lobe_level) const {
  const float clamped = std::clamp(lobe_level, 0.0f, float(kLevelCount - 1));
  const int k = std::min(int(clamped), kLevelCount - 2);
  const float fine = k == 0 ? 0.0f : light_taken(k, light_levels[i]);
  return fine + (clamped - float(k)) * (light_taken(k + 1, light_levels[i]) - fine);
}

}  // namespace fastibl
