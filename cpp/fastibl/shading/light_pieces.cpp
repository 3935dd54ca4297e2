#include "fastibl/shading/light_pieces.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/lanes.h"

namespace fastibl {
namespace {

constexpr int kMostCuts = 16;  // of a texel, along each side

struct Piece {
  glm::vec3 direction;  // unit, map frame
  glm::vec3 flux;
  float solid_angle;
};

// Splits a map by its levels, from the coarsest down: those that each have half the texels of the
// next.
class Splitter {
 public:
  Splitter(const CubeMap& map, int count) : map_(map) {
    while (coarsest_ + 1 < map.level_count() &&
           2 * map.level(coarsest_ + 1).size() == map.level(coarsest_).size())
      ++coarsest_;
    const int n = map.level(coarsest_).size();
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) all_ += flux(coarsest_, f, x, y);
    for (int c = 0; c < 3; ++c) most_[c] = all_[c] / float(count);
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) split(coarsest_, f, x, y);
  }
  std::vector<Piece> pieces;

 private:
  float angle(int level, int x, int y) const {
    return float(texel_solid_angle(x, y, map_.level(level).size()));
  }
  glm::vec3 flux(int level, int face, int x, int y) const {
    return angle(level, x, y) * map_.level(level).texel(face, x, y);
  }
  // How many times too much light a texel holds.
  float excess(glm::vec3 light) const {
    float most = 0;
    for (int c = 0; c < 3; ++c)
      if (most_[c] > 0) most = std::max(most, light[c] / most_[c]);
    return most;
  }
  void split(int level, int face, int x, int y) {
    const glm::vec3 light = flux(level, face, x, y);
    const float much = excess(light);
    if (much > 1 && level > 0) {
      for (int k = 0; k < 4; ++k) split(level - 1, face, 2 * x + k % 2, 2 * y + k / 2);
      return;
    }
    if (!(light.x + light.y + light.z > 0)) return;
    const int cuts = std::clamp(int(std::ceil(std::sqrt(much))), 1, kMostCuts);
    const int n = map_.level(level).size() * cuts;
    const float part = 1 / float(cuts * cuts);
    for (int v = 0; v < cuts; ++v)
      for (int u = 0; u < cuts; ++u) {
        // Anywhere in the piece, by Roberts' R2 sequence: middles in rows would all meet an edge at
        // once.
        const double aside = double(pieces.size()) * 0.7548776662466927,
                     down = double(pieces.size()) * 0.5698402909980532;
        const glm::dvec2 at(x * cuts + u + aside - std::floor(aside),
                            y * cuts + v + down - std::floor(down));
        const glm::vec3 d = face_direction(face, float(at.x / n), float(at.y / n));
        pieces.push_back({glm::normalize(d), part * light, part * angle(level, x, y)});
      }
  }

  const CubeMap& map_;
  int coarsest_ = 0;
  glm::vec3 all_{0}, most_{0};
};

}  // namespace

LightPieces::LightPieces(const CubeMap& map, const glm::mat3& frame_from_map, int count) {
  const std::vector<Piece> pieces = Splitter(map, count).pieces;
  count_ = pieces.size();
  const std::size_t filled = (count_ + kLanes - 1) / kLanes * kLanes;
  for (std::size_t i = 0; i < filled; ++i) {
    const Piece& piece = pieces[std::min(i, count_ - 1)];
    const glm::vec3 d = frame_from_map * piece.direction;
    const float here = i < count_ ? 1.0f : 0.0f;
    x_.push_back(d.x), y_.push_back(d.y), z_.push_back(d.z);
    solid_angles_.push_back(here * piece.solid_angle);
    for (int c = 0; c < 3; ++c) channels_[c].push_back(here * piece.flux[c]);
  }
  arrays_ = {x_.data(),
             y_.data(),
             z_.data(),
             solid_angles_.data(),
             {channels_[0].data(), channels_[1].data(), channels_[2].data()},
             filled};
}

}  // namespace fastibl
