// A picture in linear light at several sizes, for reading it with a footprint.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "fastibl/capture/code_sums.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/picture.h"

namespace fastibl {

// Levels whose pixels are means over 2, 4, … of the picture's along each axis. Rows and columns are
// one longer than the level, with the last repeated, so that a bilinear look-up needs no test.
class FrameLevels {
 public:
  static constexpr int kFirst = 1;  // level 0 is half size: a cube texel covers several pixels
  static constexpr int kMost = 5;

  struct Level {
    int width = 0, height = 0;
    std::vector<float> pixels;  // linear RGB (exposure included); fourth: above 0 if any is clipped
    std::vector<std::uint32_t> clipped;  // numbers of clipped pixels, kCountBits a channel
    const float* pixel(int x, int y) const { return &pixels[4 * index(x, y)]; }
    float* pixel(int x, int y) { return &pixels[4 * index(x, y)]; }
    std::size_t index(int x, int y) const {
      return std::size_t(y) * std::size_t(width + 1) + std::size_t(x);
    }
  };

  // Makes level 0 at least and, if the picture is large enough, `levels` levels. Memory is kept
  // from frame to frame.
  void make(const Picture& picture, const Response& response, int levels);
  int count() const { return count_; }
  const Level& level(int k) const { return levels_[std::size_t(k)]; }

 private:
  void resize(int k, int width, int height);
  void make_first(const Picture& picture, const Response& response);
  // Make a row of level 0. sums: room for three values for each of its pixels. limit: the least
  // clipped value.
  void decode_row(const Picture& picture, int y, std::uint32_t* sums);
  void take_row(const Image<float>& linear, int y, float limit);
  void halve(int k, int y);  // a row from level k − 1
  void made_row(int k, int y);
  std::vector<Level> levels_;
  int count_ = 0;
  std::optional<CodeTable> table_;
  Response table_response_;
};

}  // namespace fastibl
