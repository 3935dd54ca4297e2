// The printed board: AprilTags of family 36h11 on the plane z = 0 of the marker frame.
#pragma once

#include <array>
#include <vector>

#include "fastibl/core/vector.h"

namespace fastibl {

struct Tag {
  int id = 0;
  // Corners of the black border in metres, marker frame, in the order upper left, upper right,
  // lower right, lower left as the tag is read (x right, y up). A tag may be turned on the board;
  // the order then turns with it.
  std::array<glm::dvec2, 4> corners{};
  bool operator==(const Tag&) const = default;
};

struct Board {
  std::vector<Tag> tags = {};
  int border_bits = 1;           // width of the black border in modules
  double width = 0, height = 0;  // of the printed page in metres, centred on the origin

  // One large tag with small ones around it, on A4 landscape: seen near and far, and partly hidden.
  static Board default_board();
  // rows × columns tags of `tag_size` metres, `spacing` metres apart, ids from 0 row by row from
  // the top.
  static Board grid(int rows, int columns, double tag_size, double spacing, int border_bits = 1);
  // Kalibr's AprilGrid: borders of two modules, ids from 0 row by row from the bottom left. The
  // space between tags is `spacing_ratio` of their size. The tags are turned by half a turn
  // relative to OpenCV's.
  static Board kalibr(int rows, int columns, double tag_size, double spacing_ratio);

  // Throws std::invalid_argument for a board without tags, an id that occurs twice or is outside
  // 0…586, and sizes that are not positive and finite.
  void validate() const;
  const Tag* find(int id) const;  // null where the board has no such tag
  bool operator==(const Board&) const = default;
};

// A tag as found in a picture. Corners in the order of Tag::corners; pixel centres are at + 0.5.
struct DetectedTag {
  int id = 0;
  std::array<glm::dvec2, 4> corners{};
  bool operator==(const DetectedTag&) const = default;
};

}  // namespace fastibl
