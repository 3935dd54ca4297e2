#include "fastibl/capture/picture_bands.h"

#include <algorithm>
#include <cmath>

namespace fastibl {
namespace {

// At 60 degrees a second and 30 ms of readout, neighbouring bands differ by 0.1 degrees.
constexpr int kBands = 16;
constexpr float kMostDrift = 0.5f;  // pictures a readout; nothing moves faster in a film

}  // namespace

PictureBands::PictureBands(const PosedPicture& posed, const Viewpoint& viewpoint, int size)
    : width_(float(posed.side.camera.width)), height_(float(posed.side.camera.height)) {
  const CameraSide& side = posed.side;
  const int bands = posed.poses.rolling() ? kBands : 1;
  for (int band = 0; band < bands; ++band) {
    const Pose pose = posed.poses.at(bands == 1 ? 0.0 : (band + 0.5) / bands);
    texels_.emplace_back(side.camera, side.lens, side.bounds, pose, viewpoint, size);
    halved_.emplace_back(side.camera, side.lens, side.bounds, pose, viewpoint, size / 2);
  }
}

void PictureBands::find_tiles(const TileOutlines& outlines, std::vector<float>& most_pixels) const {
  texels_.front().find_tiles(outlines, most_pixels);
  if (count() == 1) return;
  std::vector<float> most;
  for (const TexelView* view : {&texels_[kBands / 2], &texels_.back()}) {
    view->find_tiles(outlines, most);
    for (std::size_t i = 0; i < most.size(); ++i)
      most_pixels[i] = std::max(most_pixels[i], most[i]);
  }
}

void PictureBands::place(const std::vector<int>& tiles, const TileGeometry& geometry,
                         const Surroundings& surroundings) {
  if (count() == 1) return;
  rolls_.assign(std::size_t(geometry.grid.count()), Roll{});
  const float step = 2.0f / float(geometry.grid.size);
  const float none[16] = {};
  for (const int tile : tiles) {
    const FaceRect r = tile_rect(geometry.grid, tile);
    const float s = 0.5f * step * float(r.x0 + r.x1) - 1, t = 0.5f * step * float(r.y0 + r.y1) - 1;
    const TexelGroup middle{r.face, s, t, 0, none, none, 1, 1, surroundings.depth(tile)};
    rolls_[std::size_t(tile)] = roll_of(middle, geometry.above(tile));
  }
}

PictureBands::Roll PictureBands::roll_of(const TexelGroup& middle, bool above) const {
  const float bands = float(count());
  const auto pixel_in = [&](int band) { return texels_[std::size_t(band)].pixel(middle, above); };
  // These comparisons are false for NaN.
  const auto band_of = [&](float row) {
    const float band = row / height_ * bands;
    return band > 0 ? (band < bands ? int(band) : count() - 1) : 0;
  };
  // One step of iteration from the row that the half-time pose shows it on.
  const int band = band_of(pixel_in(band_of(pixel_in(count() / 2).y)).y);
  const int other = band > 0 ? band - 1 : band + 1;
  const glm::vec2 drift = (pixel_in(other) - pixel_in(band)) * (bands / float(other - band));
  Roll roll{band, (float(band) + 0.5f) / bands * height_};
  const float most = kMostDrift * height_;
  if (std::abs(drift.x) < most && std::abs(drift.y) < most) roll.drift = drift / height_;
  return roll;
}

void PictureBands::unroll(int tile, int first, int count, Sightings& sightings) const {
  if (rolls_.empty()) return;
  const Roll& roll = rolls_[std::size_t(tile)];
  if (roll.drift == glm::vec2(0)) return;
  for (int i = first; i < first + count; ++i) {
    const float rows = (sightings.y[i] - roll.row) / (1 - roll.drift.y);
    const float x = sightings.x[i] + rows * roll.drift.x, y = sightings.y[i] + rows * roll.drift.y;
    sightings.seen[i] &= (x >= 0) & (y >= 0) & (x < width_) & (y < height_);
    if (sightings.seen[i]) sightings.x[i] = x, sightings.y[i] = y;
  }
}

}  // namespace fastibl
