#include "demo/overlays/equirect.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "fastibl/scene/response.h"

namespace fastibl::demo {
namespace {

constexpr float kUnseen = 0.3f;  // brightness factor of what no camera saw
constexpr int kStripe = 3;       // pixels

void draw_bent(Canvas& canvas, const Inset& inset, const std::vector<glm::dvec3>& directions,
               Colour colour) {
  for (std::size_t k = 0; k + 1 < directions.size(); ++k) {
    const glm::dvec2 a = in_equirect(inset, directions[k]);
    const glm::dvec2 b = in_equirect(inset, directions[k + 1]);
    if (std::abs(a.x - b.x) < inset.height) canvas.line(a, b, colour);  // no line across the seam
  }
}

}  // namespace

glm::vec3 equirect_direction(const Inset& inset, int x, int y) {
  const float azimuth = kPi * ((float(x) + 0.5f) / float(inset.height) - 1);
  const float polar = kPi * (float(y) + 0.5f) / float(inset.height);
  return {std::sin(polar) * std::sin(azimuth), std::sin(polar) * std::cos(azimuth),
          std::cos(polar)};
}

glm::dvec2 in_equirect(const Inset& inset, const glm::dvec3& direction) {
  const double z = std::clamp(direction.z / glm::length(direction), -1.0, 1.0);
  const double u = 1 + std::atan2(direction.x, direction.y) / std::numbers::pi;
  return glm::dvec2(inset.at) +
         double(inset.height) * glm::dvec2(u, std::acos(z) / std::numbers::pi);
}

void draw_equirect(Canvas& canvas, const Inset& inset, const CubeMap& map,
                   const std::vector<float>& confidence, double exposure) {
  static const ByteResponse response(Response::srgb());
  // The map's level whose texels are as large as the inset's pixels.
  const float level = std::log2(float(2 * map.size()) / float(inset.height));
  for (int y = 0; y < inset.height; ++y)
    for (int x = 0; x < 2 * inset.height; ++x) {
      const glm::vec3 direction = equirect_direction(inset, x, y);
      glm::vec3 colour = map.sample(direction, std::max(level, 0.0f)) * float(exposure);
      const TexelPlace t = texel_at(direction, map.size());
      const std::size_t texel = (std::size_t(t.face) * std::size_t(map.size()) + std::size_t(t.y)) *
                                    std::size_t(map.size()) +
                                std::size_t(t.x);
      if (!confidence.empty() && !(confidence[texel] > 0)) {
        colour *= kUnseen;
        if ((x + y) / kStripe % 2 == 0) colour += 0.06f;
      }
      std::uint8_t* pixel = canvas.pixel(inset.at.x + x, inset.at.y + y);
      for (int c = 0; c < 3; ++c) pixel[c] = response.encode(colour[c]);
    }
}

void draw_field(Canvas& canvas, const Inset& inset, const Camera& camera,
                const Pose& camera_from_marker, Colour colour) {
  const glm::dmat3 marker_from_camera = glm::transpose(camera_from_marker.rotation);
  const glm::dvec2 size(camera.width - 2.0, camera.height - 2.0);
  const glm::dvec2 corners[] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}};
  std::optional<Lens> lens;  // made once: a camera would compute it for every ray
  if (camera.model == CameraModel::perspective) lens.emplace(camera);
  std::vector<glm::dvec3> border;
  for (int side = 0; side < 4; ++side)
    for (int k = 0; k <= 16; ++k) {
      const glm::dvec2 at = glm::mix(corners[side], corners[side + 1], k / 16.0) * size + 1.0;
      if (const auto ray = lens ? lens->unproject(at) : camera.unproject(at))
        border.push_back(marker_from_camera * *ray);
    }
  draw_bent(canvas, inset, border, colour);
}

void draw_way(Canvas& canvas, const Inset& inset, const glm::dvec3& from, const glm::dvec3& to,
              Colour colour) {
  std::vector<glm::dvec3> way;
  for (int k = 0; k <= 32; ++k) way.push_back(glm::mix(from, to, k / 32.0));
  draw_bent(canvas, inset, way, colour);
}

}  // namespace fastibl::demo
