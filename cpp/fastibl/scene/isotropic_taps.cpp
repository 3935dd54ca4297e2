#include "fastibl/scene/isotropic_taps.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace fastibl {
namespace {

constexpr float kRightAngle = 0.5f * std::numbers::pi_v<float>;

}  // namespace

const IsotropicTaps& IsotropicTaps::table() {
  static const IsotropicTaps made;
  return made;
}

IsotropicTaps::IsotropicTaps() : nodes_(std::size_t(kRoughnesses) * kAngles) {
  for (int r = 0; r < kRoughnesses; ++r)
    for (int a = 0; a < kAngles; ++a) {
      const float roughness =
          kLeastRoughness + (1 - kLeastRoughness) * float(r) / (kRoughnesses - 1);
      const float left = 1 - float(a) / (kAngles - 1);
      const float angle = kRightAngle * (1 - left * left);
      const GgxTaps taps = ggx_taps({std::sin(angle), 0, std::cos(angle)},
                                    glm::vec2(roughness * roughness), GgxOptions{});
      Node& node = nodes_[std::size_t(r) * kAngles + std::size_t(a)];
      node.albedo = taps.albedo;
      for (int k = 0; k < kGgxTaps; ++k) {
        // Where nothing is reflected there is one tap, and all are copies of it.
        const GgxTap& tap = taps.taps[std::size_t(std::min(k, taps.count - 1))];
        node.across[k] = -tap.direction.x, node.up[k] = tap.direction.z;
        node.width[k] = tap.width;
        node.weight[k] = taps.count == kGgxTaps ? tap.weight : 1.0f / kGgxTaps;
      }
    }
}

GgxTaps IsotropicTaps::at(glm::vec3 view, float roughness) const {
  const float flat = std::hypot(view.x, view.y);
  const glm::vec2 away = flat > 1e-6f ? glm::vec2(-view.x, -view.y) / flat : glm::vec2(0);
  const float angle = std::atan2(flat, std::max(view.z, 0.0f));
  const float left = 1 - std::clamp(angle / kRightAngle, 0.0f, 1.0f);
  const float x = (1 - std::sqrt(left)) * (kAngles - 1);
  const float y = std::clamp((roughness - kLeastRoughness) / (1 - kLeastRoughness), 0.0f, 1.0f) *
                  (kRoughnesses - 1);
  // NaN gives 0.
  const int column = x > 0 ? std::min(int(x), kAngles - 2) : 0,
            row = y > 0 ? std::min(int(y), kRoughnesses - 2) : 0;
  const float fx = x - float(column), fy = y - float(row);
  const Node* lower = &nodes_[std::size_t(row) * kAngles + std::size_t(column)];
  const Node* upper = lower + kAngles;
  const float w[4] = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
  // Functions read the members: pointers to members lose the alignment of a float.
  const auto mean = [&](auto part) {
    return w[0] * part(lower[0]) + w[1] * part(lower[1]) + w[2] * part(upper[0]) +
           w[3] * part(upper[1]);
  };
  const Float8 across = mean([](const Node&n) { return n.across; }),
               up = mean([](const Node&n) { return n.up; }),
               width = mean([](const Node&n) { return n.width; }),
               weight = mean([](const Node&n) { return n.weight; }),
               length2 = across * across + up * up;
  GgxTaps out;
  out.count = kGgxTaps;
  out.albedo = mean([](const Node& n) { return n.albedo; });
  for (int k = 0; k < kGgxTaps; ++k) {
    const float scale = 1 / std::sqrt(length2[k]), flat_part = scale * across[k];
    out.taps[std::size_t(k)] = {
        {flat_part * away.x, flat_part * away.y, scale * up[k]}, width[k], weight[k]};
  }
  return out;
}

}  // namespace fastibl
