#include "fastibl/tracking/picture_features.h"

#include <algorithm>

#include "fastibl/core/pose.h"

namespace fastibl {
namespace {

constexpr int kCell[] = {6, 4, 3};  // by level: blocks along an edge of which one place is taken
constexpr int kBorder = 2;          // blocks at the picture's edge that are not taken
constexpr float kHorizon = 0.03f;   // sine of the least elevation: the plane's edge is near
constexpr float kWhitest = 0.9f;    // linear
constexpr float kDarkest = 0.004f;  // linear: what is darker is noise
constexpr float kLeastGradient = 0.06f;  // relative, from one block to the next
constexpr float kSignificant = 16;  // squared gradient by what noise makes of it: of all places of
                                    // a cell, noise alone hardly ever reaches it
constexpr float kApart = 2.0f;      // blocks between features of a tile

// Relative variance of a block's mean of a linear value, as for a small sensor.
float noise_of(float value, int block) {
  return (4e-6f + value / 3000) / (float(block * block) * value * value);
}

}  // namespace

BlockRays::BlockRays(const Camera& camera, const Lens& lens) {
  for (int k = 0; k < MapFeatures::kLevels; ++k) {
    const int block = LightPyramid::kFirstBlock << (kFirst + k);
    const int width = camera.width / block, height = camera.height / block;
    rays[std::size_t(k)].reserve(std::size_t(width) * std::size_t(height));
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const auto ray = lens.unproject({(x + 0.5) * block, (y + 0.5) * block});
        rays[std::size_t(k)].push_back(ray ? glm::vec3(glm::normalize(*ray)) : glm::vec3(0));
      }
  }
}

PictureFeatures::PictureFeatures() { clear(); }

void PictureFeatures::clear() {
  tiles_.assign(std::size_t(grid_.count()), Tile{});
  for (int t = 0; t < grid_.count(); ++t) tiles_[std::size_t(t)].cone = tile_cone(grid_, t);
}

std::size_t PictureFeatures::index(const glm::vec3& direction) const {
  const TexelPlace at = texel_at(direction, grid_.size);
  return std::size_t((at.face * grid_.size + at.y) * grid_.size + at.x);
}

// Takes the place of a cell whose light changes most.
void PictureFeatures::consider(const MapView& view, const BlockRays& rays,
                               const std::vector<glm::mat3>& marker_from_camera, int level, int x0,
                               int y0, float drift, float dark) {
  const LightPyramid::Level& l = view.light->level(BlockRays::kFirst + level);
  const auto at = [&](int x, int y) {
    return l.light[std::size_t(y) * std::size_t(l.width) + std::size_t(x)];
  };
  const auto ray_at = [&](int x, int y) {
    return rays.rays[std::size_t(level)][std::size_t(y) * std::size_t(l.width) + std::size_t(x)];
  };
  const int cell = kCell[level];
  const auto full = [&](const glm::vec3& d) {
    return int(tiles_[index(d)].features[level].size()) >= kPerTile[level];
  };
  const auto turn = [&](int y) { return marker_from_camera[std::size_t(y)]; };
  const auto recorded = [&](const glm::vec3& seen) {
    return glm::vec3(view.recorded(glm::dvec3(seen)));
  };
  const glm::vec3 middle = recorded(turn(y0 + cell / 2) * ray_at(x0 + cell / 2, y0 + cell / 2));
  if (!(middle.z > 0) || full(middle)) return;
  float most = kLeastGradient * kLeastGradient;
  int bx = -1, by = -1;
  for (int y = y0; y < y0 + cell; ++y)
    for (int x = x0; x < x0 + cell; ++x) {
      const float v = at(x, y);
      if (!(v > kDarkest && v < kWhitest)) continue;
      const float gx = 0.5f * (at(x + 1, y) - at(x - 1, y)),
                  gy = 0.5f * (at(x, y + 1) - at(x, y - 1));
      const float strength = (gx * gx + gy * gy) / ((v + dark) * (v + dark));
      if (strength > most && strength > kSignificant * noise_of(v, l.block))
        most = strength, bx = x, by = y;
    }
  if (bx < 0) return;
  const auto clipped = [&](int x, int y) { return at(x, y) > 1; };
  if (clipped(bx + 1, by) || clipped(bx - 1, by) || clipped(bx, by + 1) || clipped(bx, by - 1))
    return;
  const glm::vec3 ray = ray_at(bx, by), right = ray_at(bx + 1, by), down = ray_at(bx, by + 1);
  if (!(ray.z > 0 && right.z > 0 && down.z > 0)) return;
  const glm::vec3 seen = turn(by) * ray;
  if (!(seen.z > std::max(kHorizon, 2 * glm::length(right - ray)))) return;
  const glm::vec3 d = recorded(seen);
  if (full(d)) return;
  std::vector<MapFeature>& features = tiles_[index(d)].features[level];
  const glm::vec3 u = turn(by) * (right - ray), v = turn(by + 1) * down - seen;
  const float width = 0.5f * (glm::length(u) + glm::length(v));
  for (const MapFeature& f : features)
    if (glm::length(f.direction - d) < kApart * width) return;
  const double vignette = view.camera->vignetting.empty()
                              ? 1.0
                              : view.camera->vignette({(bx + 0.5) * l.block, (by + 0.5) * l.block});
  const float scale = float(1 / std::max(view.exposure * view.camera->gain * vignette, 1e-30));
  const float lu = 0.5f * scale * (at(bx + 1, by) - at(bx - 1, by)),
              lv = 0.5f * scale * (at(bx, by + 1) - at(bx, by - 1));
  const float light = scale * at(bx, by);
  features.push_back({d, glm::cross(seen, tangent_gradient(u, v, lu, lv)), light,
                      noise_of(at(bx, by), l.block), width, drift, 0});
}

void PictureFeatures::add(const MapView& view, const BlockRays& rays,
                          const glm::dmat3& rig_from_marker, float drift, double dark) {
  const float relative_dark = float(dark * view.exposure * view.camera->gain) + 0.0005f;
  for (int level = 0; level < kLevels; ++level) {
    const LightPyramid::Level& l = view.light->level(BlockRays::kFirst + level);
    const int cell = kCell[level];
    std::vector<glm::mat3> marker_from_camera;
    for (int y = 0; y < l.height; ++y) {
      const double share = (y + 0.5) * l.block / view.camera->height;
      const glm::dmat3 rig = rig_from_marker * rotation_from_vector(share * view.turn);
      marker_from_camera.emplace_back(glm::transpose(view.camera_from_rig * rig));
    }
    for (int y = kBorder; y + cell + kBorder <= l.height; y += cell)
      for (int x = kBorder; x + cell + kBorder <= l.width; x += cell)
        consider(view, rays, marker_from_camera, level, x, y, drift, relative_dark);
  }
}

void PictureFeatures::forget_missed() {
  for (Tile& tile : tiles_)
    for (auto& features : tile.features)
      std::erase_if(features, [](const MapFeature& f) { return f.missed >= kMostMissed; });
}

}  // namespace fastibl
