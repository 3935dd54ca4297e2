// What the map knows of the places that a picture shows.
#include <algorithm>
#include <cmath>

#include "fastibl/capture/capture.h"

namespace fastibl {
namespace {

constexpr int kColumns = 24, kRows = 18;  // of probes over a picture
constexpr int kLargest = 8;               // pixels along an edge of one
constexpr float kKnown = 0.15f;           // relative standard deviation of what counts as known

struct Part {
  glm::vec3 linear{0};
  bool clipped = false;
};

// Mean of the size × size pixels from (x, y) on.
Part part_of(const Picture& picture, const ByteResponse& bytes, int x, int y, int size) {
  Part part;
  for (int v = y; v < y + size; ++v) {
    const std::uint8_t* at = picture.row(v) + 3 * x;
    for (int i = 0; i < 3 * size; ++i) {
      part.linear[i % 3] += bytes.decode(at[i]);
      part.clipped |= at[i] >= CodeTable::kClippedCode;
    }
  }
  part.linear /= float(size * size);
  return part;
}

Part part_of(const Picture& picture, const Response& response, int x, int y, int size) {
  Part part;
  Picture cut = picture;
  const int bytes = picture.type == PixelType::uint16 ? 2 : 4;
  cut.data = picture.row(y) + 3 * bytes * x, cut.width = cut.height = size;
  const Image<float> linear = linear_from(cut, response);
  const bool clips = picture.type == PixelType::uint16;
  const float limit = response.decode(CodeTable::kClippedCode / 255.0f);
  for (int v = 0; v < size; ++v)
    for (int u = 0; u < size; ++u)
      for (int c = 0; c < 3; ++c) {
        part.linear[c] += linear.pixel(u, v)[c];
        part.clipped |= clips && linear.pixel(u, v)[c] >= limit;
      }
  part.linear /= float(size * size);
  return part;
}

}  // namespace

void Capture::probe_level(const Picture& picture, KnownCamera& k, const RowPoses& poses,
                          ImageView<const std::uint8_t> mask,
                          std::vector<LevelProbe>& probes) const {
  const Camera& camera = k.camera;
  if (picture.type == PixelType::uint8 && !k.bytes) k.bytes.emplace(camera.response);
  // As large as a texel in the middle of a face.
  const int texel = int(std::lround(2 * std::min(camera.fx, camera.fy) / grid_.size));
  const int size = std::min({std::clamp(texel, 1, kLargest), picture.width, picture.height});
  glm::dvec2 page(-1);
  if (options_.board) page = 0.5 * glm::dvec2(options_.board->width, options_.board->height);
  const int edge = grid_.per_edge();
  for (int row = 0; row < kRows; ++row) {
    const double cy = (row + 0.5) * picture.height / kRows;
    const Pose marker_from_camera = poses.at(cy / picture.height).inverse();
    const glm::dvec3& eye = marker_from_camera.translation;
    for (int column = 0; column < kColumns; ++column) {
      const double cx = (column + 0.5) * picture.width / kColumns;
      const int x = std::clamp(int(cx) - size / 2, 0, picture.width - size);
      const int y = std::clamp(int(cy) - size / 2, 0, picture.height - size);
      if (!mask.empty() && !*mask.pixel(int(cx), int(cy))) continue;
      const auto ray = k.lens.unproject({cx, cy});
      if (!ray) continue;
      glm::dvec3 direction = glm::normalize(marker_from_camera.rotation * *ray);
      if (direction.z >= 0) {
        direction = surroundings_.recorded(eye, direction);
      } else {
        if (!(eye.z > 0)) continue;
        const glm::dvec3 point = eye - eye.z / direction.z * direction;
        if (std::abs(point.x) <= page.x && std::abs(point.y) <= page.y) continue;
        direction = point - options_.centre;
      }
      const FacePoint p = face_point(glm::vec3(direction));
      const int tx = std::clamp(int(p.s * float(grid_.size)), 0, grid_.size - 1);
      const int ty = std::clamp(int(p.t * float(grid_.size)), 0, grid_.size - 1);
      // Inverse of TileGrid::begin.
      const int tile_x = ((tx + 1) * edge - 1) / grid_.size;
      const int tile_y = ((ty + 1) * edge - 1) / grid_.size;
      const int tile = p.face * grid_.per_face() + tile_y * edge + tile_x;
      const FaceRect r = tile_rect(grid_, tile);
      const int in_tile = (ty - r.y0) * r.width() + tx - r.x0;
      if (!(state_.last_seen.at(tile, in_tile) > kNever)) continue;
      const std::size_t at = std::size_t(tile) * std::size_t(grid_.stride()) + std::size_t(in_tile);
      if (state_.bound[at]) continue;
      LevelProbe probe{};
      bool known = true;
      for (int c = 0; c < 3; ++c) {
        const float value = state_.value[c][at];
        known &= value > 0 && state_.variance[c][at] < kKnown * kKnown * value * value;
        probe.expected[c] = value * float(camera.gain * k.vignette(float(cx), float(cy)));
      }
      if (!known) continue;
      const Part part = picture.type == PixelType::uint8
                            ? part_of(picture, *k.bytes, x, y, size)
                            : part_of(picture, camera.response, x, y, size);
      probe.linear = part.linear, probe.clipped = part.clipped;
      probes.push_back(probe);
    }
  }
}

}  // namespace fastibl
