#include "fastibl/tracking/tag_edges.h"

#include <algorithm>

#include "fastibl/scene/tag_codes.h"

namespace fastibl {
namespace {

constexpr int kMostRoom = 4;  // modules looked at on either side

// A tag's colours by module; white around it, as wide as its border.
class Modules {
 public:
  Modules(int id, int border) : id_(id), border_(border), n_(kTagModules + 2 * border) {}
  int count() const { return n_; }
  bool known(int row, int column) const {
    return row >= -border_ && column >= -border_ && row < n_ + border_ && column < n_ + border_;
  }
  bool black(int row, int column) const {
    if (row < 0 || column < 0 || row >= n_ || column >= n_) return false;
    const int r = row - border_, c = column - border_;
    if (r < 0 || c < 0 || r >= kTagModules || c >= kTagModules) return true;
    return tag_module_black(id_, r, c);
  }

 private:
  int id_, border_, n_;
};

// Number of modules of one colour from (row, column) on.
std::uint8_t run(const Modules& modules, int row, int column, int down, int right) {
  const bool black = modules.black(row, column);
  int count = 0;
  while (count < kMostRoom && modules.known(row, column) && modules.black(row, column) == black)
    ++count, row += down, column += right;
  return std::uint8_t(count);
}

// Edge between module (row, column) and the one above it (or on its left), if there is one.
void add_edge(const Modules& modules, int row, int column, bool upright,
              std::vector<TagEdge>& edges) {
  const int up = upright ? 0 : 1, left = upright ? 1 : 0;
  const auto here = [&](int step) { return modules.black(row + left * step, column + up * step); };
  const auto before = [&](int step) {
    return modules.black(row + left * step - up, column + up * step - left);
  };
  if (here(0) == before(0)) return;
  const bool black_here = here(0);
  const auto goes_on = [&](int step) {
    return here(step) == black_here && before(step) == !black_here;
  };
  TagEdge edge;
  const int stride = modules.count() + 1, node = row * stride + column;
  const int next = upright ? node + stride : node + 1;
  const std::uint8_t ahead = run(modules, row, column, up, left),
                     behind = run(modules, row - up, column - left, -up, -left);
  edge.black = black_here ? ahead : behind, edge.white = black_here ? behind : ahead;
  edge.outer =
      upright ? column == 0 || column == modules.count() : row == 0 || row == modules.count();
  // White is on the left of a direction to the right where it lies above, and of one upwards where
  // it lies on the left.
  const bool forward = upright ? !black_here : black_here;
  edge.from = std::uint16_t(forward ? node : next), edge.to = std::uint16_t(forward ? next : node);
  edge.from_ends = !goes_on(forward ? -1 : 1), edge.to_ends = !goes_on(forward ? 1 : -1);
  edges.push_back(edge);
}

TagPattern pattern_of(const Tag& tag, int border) {
  const Modules modules(tag.id, border);
  const int n = modules.count();
  const auto at = [&](double u, double v) {
    const auto& c = tag.corners;
    return (1 - v) * ((1 - u) * c[0] + u * c[1]) + v * ((1 - u) * c[3] + u * c[2]);
  };
  TagPattern pattern{tag.id, {}, {}, {}};
  for (int row = 0; row <= n; ++row)
    for (int column = 0; column <= n; ++column)
      pattern.nodes.push_back(at(double(column) / n, double(row) / n));
  for (int row = 0; row < kTagModules; ++row)
    for (int column = 0; column < kTagModules; ++column)
      pattern.black.push_back(tag_module_black(tag.id, row, column));
  for (int row = 0; row <= n; ++row)
    for (int column = 0; column < n; ++column) add_edge(modules, row, column, false, pattern.edges);
  for (int row = 0; row < n; ++row)
    for (int column = 0; column <= n; ++column) add_edge(modules, row, column, true, pattern.edges);
  std::stable_partition(pattern.edges.begin(), pattern.edges.end(),
                        [](const TagEdge& edge) { return edge.outer; });
  return pattern;
}

}  // namespace

BoardPattern pattern_of(const Board& board) {
  BoardPattern pattern;
  pattern.border = board.border_bits;
  pattern.modules = kTagModules + 2 * board.border_bits;
  for (const Tag& tag : board.tags) pattern.tags.push_back(pattern_of(tag, board.border_bits));
  return pattern;
}

}  // namespace fastibl
