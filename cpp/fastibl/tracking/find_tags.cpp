#include "fastibl/tracking/find_tags.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>

#include "fastibl/core/lanes.h"
#include "fastibl/core/simd.h"
#include "fastibl/scene/tag_codes.h"

namespace fastibl {
namespace {

constexpr std::size_t kAnchors = 4;  // largest tags, one of which has to be found
constexpr std::size_t kMostTags = 48;
constexpr double kSurely = 0.8;  // match from which no other one is looked for
// Shifts of two tags may differ by this share of the way between them, and by these pixels.
constexpr double kTurn = 0.25, kSlack = 4;
constexpr int kData = kTagModules * kTagModules;

// Codes of a part of the picture less kMiddle, 0 outside the picture. Rows are read, and take
// memory, when they are asked for: few are, of a tag that fills a large picture.
class Window {
 public:
  static constexpr float kMiddle = 128;

  Window(const LightReader& light) : light_(light) {}

  void place(int left, int top, int width, int height) {
    left_ = left, top_ = top, width_ = width;
    stride_ = std::size_t(width) + kLanes;  // whole registers are read from the last column, too
    if (const std::size_t size = stride_ * std::size_t(height); size > size_)
      codes_ = std::make_unique_for_overwrite<float[]>(size), size_ = size;
    inside_.assign(stride_, 0.f), read_.assign(std::size_t(height), false);
    for (int x = first(); x < last(); ++x) inside_[std::size_t(x - left)] = 1;
  }
  // The codes of a row that is in the picture, from a column on.
  const float* codes(int x, int y) {
    const auto row = std::size_t(y - top_);
    if (!read_[row]) read(row), read_[row] = true;
    return &codes_[row * stride_ + std::size_t(x - left_)];
  }
  const float* inside(int x) const { return &inside_[std::size_t(x - left_)]; }

 private:
  int first() const { return std::max(left_, 0); }
  int last() const { return std::min(left_ + width_, light_.width()); }
  void read(std::size_t row) {
    float* to = &codes_[row * stride_];
    std::fill(to, to + stride_, 0.f);
    for (int x = first(); x < last(); ++x)
      to[x - left_] = float(light_.code(x, top_ + int(row))) - kMiddle;
  }

  const LightReader& light_;
  int left_ = 0, top_ = 0, width_ = 0;
  std::size_t stride_ = 0, size_ = 0;
  std::unique_ptr<float[]> codes_;
  std::vector<float> inside_;
  std::vector<bool> read_;
};

// Correlation of a code with the picture at its modules' middles, white ones first, at `count`
// shifts to the right and some more, to whole registers.
template <typename V>
FASTIBL_INLINE void correlate_by(const float* const* codes, const float* const* inside, int whites,
                                 int modules, int count, float* out) {
  for (int x = 0; x < count; x += kFloatsIn<V>) {
    V n{}, sum{}, squares{}, white_n{}, white_sum{};
    for (int k = 0; k < modules; ++k) {
      const V v = floats_at<V>(codes[k] + x);
      n += floats_at<V>(inside[k] + x);
      sum += v, squares += v * v;
      if (k + 1 == whites) white_n = n, white_sum = sum;
    }
    const V spread = (n * squares - sum * sum) * (white_n * (n - white_n));
    const V match = n * white_sum - white_n * sum;
    for (int k = 0; k < kFloatsIn<V>; ++k)
      out[x + k] = n[k] >= kData / 2 && spread[k] > 0 ? match[k] / std::sqrt(spread[k]) : 0;
  }
}
FASTIBL_BY_WIDTH(void correlate(const float* const* codes, const float* const* inside, int whites,
                                int modules, int count, float* out),
                 correlate_by<V>(codes, inside, whites, modules, count, out))

class Search {
 public:
  Search(const LightReader& light, const BoardPattern& pattern)
      : light_(light), pattern_(pattern), window_(light) {}

  // The best match within `reach` of a shift. A tag that mostly lies beside the picture has no
  // match: it may be millions of pixels large.
  FoundTag best(std::span<const ProjectedTag> tags, std::size_t which, const glm::dvec2& centre,
                double reach) {
    const ProjectedTag& tag = tags[which];
    if (!place_modules(tag)) return {which, centre, 0};
    const int r = int(std::ceil(reach)), cx = int(std::lround(centre.x)),
              cy = int(std::lround(centre.y));
    const auto [left, right] =
        std::minmax_element(places_, places_ + kData,
                            [](const glm::ivec2& a, const glm::ivec2& b) { return a.x < b.x; });
    const auto [top, bottom] =
        std::minmax_element(places_, places_ + kData,
                            [](const glm::ivec2& a, const glm::ivec2& b) { return a.y < b.y; });
    window_.place(left->x + cx - r, top->y + cy - r, right->x - left->x + 2 * r + 1,
                  bottom->y - top->y + 2 * r + 1);
    FoundTag found{which, centre, 0};
    const int step = std::max(1, int(0.45 * tag.module));
    const int rows = r / step * step;
    look(cx, cy, r, rows, step, found);
    for (int finer = step; finer > 1;) {
      finer = std::max(1, finer / 2);
      const int x = int(found.shift.x), y = int(found.shift.y);
      for (const int by : {-finer, finer})
        if (std::abs(y + by - cy) <= r)
          look(x, y + by, std::min(finer, r - std::abs(x - cx)), 0, 1, found);
    }
    return found;
  }

 private:
  bool place_modules(const ProjectedTag& tag) {
    const glm::dvec2 size(light_.width(), light_.height());
    const std::vector<bool>& black = pattern_.tags[tag.index].black;
    int white = 0, last = kData;
    for (int row = 0; row < kTagModules; ++row)
      for (int column = 0; column < kTagModules; ++column) {
        const glm::dvec2 p = module_middle(pattern_, tag, row, column);
        if (!glm::all(glm::lessThan(glm::abs(p - 0.5 * size), size))) return false;  // or no number
        const bool is_black = black[std::size_t(row * kTagModules + column)];
        places_[is_black ? --last : white++] = {int(std::floor(p.x)), int(std::floor(p.y))};
      }
    whites_ = white;
    return true;
  }

  void look(int cx, int cy, int reach_x, int reach_y, int step, FoundTag& found) {
    const float *codes[kData], *inside[kData];
    const int first = cx - reach_x, count = 2 * reach_x + 1;
    matches_.resize(std::size_t(count + kLanes));
    for (int y = cy - reach_y; y <= cy + reach_y; y += step) {
      int modules = 0, whites = 0;
      for (int k = 0; k < kData; ++k) {
        const glm::ivec2 at = places_[k] + glm::ivec2(first, y);
        if (at.y < 0 || at.y >= light_.height()) continue;
        codes[modules] = window_.codes(at.x, at.y), inside[modules++] = window_.inside(at.x);
        whites += k < whites_;
      }
      correlate(codes, inside, whites, modules, count, matches_.data());
      const auto best = std::max_element(matches_.begin(), matches_.begin() + count);
      if (*best > found.match)
        found.match = *best, found.shift = {first + int(best - matches_.begin()), y};
    }
  }

  const LightReader& light_;
  const BoardPattern& pattern_;
  Window window_;
  glm::ivec2 places_[kData];
  int whites_ = 0;
  std::vector<float> matches_;
};

glm::dvec2 middle_of(const ProjectedTag& tag) {
  return 0.5 * (tag.nodes.front() + tag.nodes.back());
}

}  // namespace

std::vector<FoundTag> find_tags(const LightReader& light, const BoardPattern& pattern,
                                std::span<const ProjectedTag> tags, double radius) {
  std::vector<std::size_t> left(tags.size());
  std::iota(left.begin(), left.end(), std::size_t(0));
  std::stable_sort(left.begin(), left.end(),
                   [&](std::size_t a, std::size_t b) { return tags[a].module > tags[b].module; });
  Search search(light, pattern);
  FoundTag anchor;
  for (std::size_t k = 0; k < std::min(left.size(), kAnchors) && anchor.match < kSurely; ++k) {
    const FoundTag found = search.best(tags, left[k], glm::dvec2(0), radius);
    if (found.match > anchor.match) anchor = found;
  }
  if (anchor.match < kCodeSeen) return {};
  std::vector<FoundTag> found = {anchor};
  std::erase(left, anchor.which);
  // How far each tag is from the nearest that was found, and which one that is.
  std::vector<double> away(tags.size(), 1e9);
  std::vector<std::size_t> nearest(tags.size(), 0);
  const auto measure = [&] {
    for (const std::size_t k : left) {
      const double d = glm::length(middle_of(tags[k]) - middle_of(tags[found.back().which]));
      if (d < away[k]) away[k] = d, nearest[k] = found.size() - 1;
    }
  };
  measure();
  left.resize(std::min(left.size(), kMostTags));
  while (!left.empty()) {
    const auto next = std::min_element(
        left.begin(), left.end(), [&](std::size_t a, std::size_t b) { return away[a] < away[b]; });
    const std::size_t which = *next;
    left.erase(next);
    const glm::dvec2& shift = found[nearest[which]].shift;
    FoundTag tag = search.best(tags, which, shift, kSlack);
    if (tag.match < kSurely)
      tag = search.best(tags, which, shift, std::min(radius, kSlack + kTurn * away[which]));
    if (tag.match < kCodeSeen) continue;
    found.push_back(tag);
    measure();
  }
  return found;
}

}  // namespace fastibl
