#include "fastibl/capture/quiet_tiles.h"

#include <algorithm>
#include <cmath>

#include "fastibl/capture/texel_state.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/environment.h"

namespace fastibl {
namespace {

constexpr int kProbesPerEdge = 4;
// Relative to a sample's variance, which is at least that of misregistration.
constexpr float kDrift = kUnsureRate * kUnsureRate / (kModelNoise * kModelNoise);  // in a second
// The share of the step to the next texel (of half the width) by which a sample may be off.
constexpr float kOffset = 0.5f;

// Blocks of 2 × 2 tiles take turns: work is spread over pictures, and still coherent.
int turn_of(const TileGrid& grid, int tile) {
  const int in_face = tile % grid.per_face();
  const int x = in_face % grid.per_edge() / 2, y = in_face / grid.per_edge() / 2;
  return (x + 2 * y) % (QuietTiles::kMostLeftOut + 1);
}

FASTIBL_CLONES void largest_of_blocks(int first, int count, int width, const float* texels,
                                      float* blocks) {
  const int edge = width / kProbesPerEdge;
  if (width == 16) {  // a row is one vector
    for (int row = 0; row < count / 16; ++row) {
      const Float16& texel = *reinterpret_cast<const Float16*>(texels + 16 * row);
      const Float4 a = __builtin_shufflevector(texel, texel, 0, 4, 8, 12);
      const Float4 b = __builtin_shufflevector(texel, texel, 1, 5, 9, 13);
      const Float4 c = __builtin_shufflevector(texel, texel, 2, 6, 10, 14);
      const Float4 d = __builtin_shufflevector(texel, texel, 3, 7, 11, 15);
      Float4& block = *reinterpret_cast<Float4*>(blocks + (first / 16 + row) / 4 * 4);
      const Float4 ab = a > b ? a : b, cd = c > d ? c : d, most = ab > cd ? ab : cd;
      block = most > block ? most : block;
    }
    return;
  }
  for (int i = 0; i < count; i += edge) {
    const int y = (first + i) / width, x = (first + i) % width;
    float& block = blocks[y / edge * kProbesPerEdge + x / edge];
    for (int k = i; k < i + edge; ++k) block = texels[k] > block ? texels[k] : block;
  }
}

}  // namespace

QuietTiles::QuietTiles(TileGrid grid) : grid_(grid), width_(0) {
  if (TilePyramids::width_of(grid) / 2 < kProbesPerEdge) return;
  width_ = TilePyramids::width_of(grid) / 2;
  tiles_.resize(std::size_t(grid.count()));
  for (Tile& tile : tiles_) std::fill_n(tile.taken, kProbes, kNever);
  values_.assign(tiles_.size() * 6 * kProbes, 0.0f);
}

bool QuietTiles::may_leave_out(int tile, double time) const {
  if (width_ == 0) return false;
  const Tile& t = tiles_[std::size_t(tile)];
  const double latest = *std::max_element(t.taken, t.taken + kProbes);
  return t.left_out < kMostLeftOut && kDrift * float(time - latest) <= kMostUnsure;
}

bool QuietTiles::leave_out(int tile, const TileSighting& s, const int* seen,
                           const float* deviance) {
  Tile& t = tiles_[std::size_t(tile)];
  if (s.most_scale > t.bound_scale) return false;
  // A sample's variance falls at most with the square of the scale and the number of pixels.
  const float scale = std::max(1.0f, t.most_scale / s.least_scale);
  const float limit = kMostUnsure / (scale * scale * std::max(1.0f, s.pixels / t.pixels));
  int count = 0;
  float sum = 0;
  for (int p = 0; p < kProbes; ++p) {
    if (!seen[p]) continue;
    if (!(t.unsure[p] + kDrift * float(s.time - t.taken[p]) <= limit)) return false;
    ++count, sum += deviance[p];
  }
  if (!(sum <= kMostDeviance * 3 * float(count))) return false;
  ++t.left_out;
  return true;
}

void QuietTiles::took(int tile, const TileSighting& s, const float (&unsure)[kProbes], bool whole,
                      bool bounded) {
  if (width_ == 0) return;
  Tile& t = tiles_[std::size_t(tile)];
  for (int p = 0; p < kProbes; ++p)
    if (unsure[p] >= 0) t.taken[p] = s.time, t.unsure[p] = unsure[p];
  t.bound_scale = !bounded ? std::numeric_limits<float>::infinity()
                  : whole  ? s.least_scale
                           : std::min(t.bound_scale, s.least_scale);
  t.most_scale = s.most_scale, t.pixels = s.pixels;
  t.left_out = t.left_out >= kMostLeftOut ? 0 : turn_of(grid_, tile);
  ++t.turn;
}

void QuietTiles::add_blocks(int first, int count, const float* texels,
                            float (&blocks)[kProbes]) const {
  if (width_ > 0) largest_of_blocks(first, count, 2 * width_, texels, blocks);
}

void QuietTiles::places(int tile, Place (&probes)[kProbes]) const {
  const int step = width_ / kProbesPerEdge, turn = tiles_[std::size_t(tile)].turn;
  const int x = turn % step, y = turn / step % step;
  for (int p = 0; p < kProbes; ++p)
    probes[p] = {p % kProbesPerEdge * step + x, p / kProbesPerEdge * step + y};
}

void QuietTiles::place_probes(int tile, const TilePyramids& texels) {
  if (width_ == 0) return;
  const int w = width_;
  float* out = &values_[std::size_t(tile) * 6 * kProbes];
  Place probes[kProbes];
  places(tile, probes);
  for (int c = 0; c < 3; ++c) {
    const float* level = texels.level(tile, c, 1);
    for (int p = 0; p < kProbes; ++p) {
      const auto [x, y] = probes[p];
      const float* at = level + y * w + x;
      const float left = std::fabs(at[x > 0 ? -1 : 0] - *at),
                  right = std::fabs(at[x + 1 < w ? 1 : 0] - *at),
                  up = std::fabs(at[y > 0 ? -w : 0] - *at),
                  down = std::fabs(at[y + 1 < w ? w : 0] - *at);
      const float off = kOffset * std::max(std::max(left, right), std::max(up, down));
      out[c * kProbes + p] = *at, out[(3 + c) * kProbes + p] = off * off;
    }
  }
}

}  // namespace fastibl
