#include "fastibl/tracking/fit_pixels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "fastibl/core/lanes.h"
#include "fastibl/core/solve.h"
#include "fastibl/tracking/fit.h"

namespace fastibl {
namespace {

constexpr int kMotion = 7;          // pose and blur
constexpr int kSums = kMotion + 3;  // and level of black, step to white, residual
// Distances from an edge, in deviations of the blur, between which slope²/variance is near its
// most. Farther on black the slope is gone; on white the noise is larger.
constexpr double kBest = 0.45, kNarrowest = 1.0, kWidest = 2.2;
constexpr double kLeastModule = 2.2;  // deviations of the blur: modules narrower than that blend
constexpr int kLeastPixels = 24;
constexpr float kDark = 0.05f;  // of white: noise that is there without light, as light
constexpr float kTukey = 4.685f;
constexpr float kBadTag = 2.5f;  // times the usual deviation
constexpr double kLeastBlur = 0.3, kMostBlur = 3;

// Pixels near edges, side by side: the place in their black module, the module's size in px across
// its directions, how u and v change with a shift of the board (camera frame), the place on the
// board turned into the camera, white of the modules around.
enum Field {
  kU,
  kV,
  kSizeU,
  kSizeV,
  kSlant,
  kGu,
  kGv = kGu + 3,
  kPlace = kGv + 3,
  kWhite = kPlace + 3,
  kLight = kWhite + 9,
  kCounts,
  kFields
};
// Whole registers of AVX-512, where std::array of them is not aligned.
template <int Count>
struct alignas(sizeof(Lanes)) Rows {
  Lanes row[Count];
  // The numbers of a row that V holds, from `lane` on.
  template <typename V>
  FASTIBL_INLINE V at(std::size_t k, int lane) const {
    return floats_at<V>(reinterpret_cast<const float*>(row + k) + lane);
  }
  template <typename V>
  FASTIBL_INLINE void set(std::size_t k, int lane, const V& value) {
    put_floats(value, reinterpret_cast<float*>(row + k) + lane);
  }
};
using Block = Rows<kFields>;
// What the pixels should show for a step of 1, and how that changes with motion and blur.
using Expected = Rows<kMotion + 1>;

// Share of a normal distribution below x, and its density: Abramowitz and Stegun, 26.2.16.
template <typename V>
FASTIBL_INLINE void normal(const V& x, V& below, V& density) {
  const V size = x < 0 ? -x : x;
  exp_negative(-0.5f * x * x, density);
  density *= 0.39894228f;
  const V t = 1 / (1 + 0.33267f * size);
  const V tail = density * t * (0.4361836f + t * (0.937298f * t - 0.1201676f));
  below = x < 0 ? tail : 1 - tail;
}

template <typename V>
FASTIBL_INLINE void shares(const V& first, const V& size, V* share, V* moved, V* blurred) {
  const V second = first - size;
  V a, b, p, q;
  normal(first, a, p), normal(second, b, q);
  share[0] = 1 - a, share[1] = a - b, share[2] = b;
  moved[0] = -p, moved[1] = p - q, moved[2] = q;
  p *= first, q *= second;
  blurred[0] = p, blurred[1] = q - p, blurred[2] = -q;
}

template <typename V>
FASTIBL_INLINE void expect_by(const Block* blocks, std::size_t count, float blur, Expected* out) {
  const float sharp = 1 / blur;
  for (std::size_t k = 0; k < count; ++k)
    for (int lane = 0; lane < kLanes; lane += kFloatsIn<V>) {
      const auto p = [&](std::size_t field) { return blocks[k].at<V>(field, lane); };
      const V size_u = p(kSizeU) * sharp, size_v = p(kSizeV) * sharp;
      V across[9], down[9];
      shares<V>(p(kU) * size_u, size_u, across, across + 3, across + 6);
      shares<V>(p(kV) * size_v, size_v, down, down + 3, down + 6);
      V sum{}, by_u{}, by_v{}, by_blur{};
      for (std::size_t i = 0; i < 3; ++i) {
        const V w[3] = {p(kWhite + 3 * i), p(kWhite + 3 * i + 1), p(kWhite + 3 * i + 2)};
        const V share = w[0] * across[0] + w[1] * across[1] + w[2] * across[2];
        const V moved = w[0] * across[3] + w[1] * across[4] + w[2] * across[5];
        const V blurred = w[0] * across[6] + w[1] * across[7] + w[2] * across[8];
        // A corner that is no right angle: first term of the tetrachoric series.
        sum += down[i] * share + p(kSlant) * down[3 + i] * moved;
        by_u += down[i] * moved, by_v += down[3 + i] * share;
        by_blur += down[i] * blurred + down[6 + i] * share;
      }
      by_u *= size_u, by_v *= size_v;
      const V at[3] = {p(kPlace), p(kPlace + 1), p(kPlace + 2)};
      V g[3];
      for (std::size_t i = 0; i < 3; ++i) g[i] = -(by_u * p(kGu + i) + by_v * p(kGv + i));
      const V expected[kMotion + 1] = {at[1] * g[2] - at[2] * g[1],
                                       at[2] * g[0] - at[0] * g[2],
                                       at[0] * g[1] - at[1] * g[0],
                                       g[0],
                                       g[1],
                                       g[2],
                                       by_blur * sharp,
                                       sum};
      for (std::size_t i = 0; i <= kMotion; ++i) out[k].set(i, lane, expected[i]);
    }
}
FASTIBL_BY_WIDTH(void expect(const Block* blocks, std::size_t count, float blur, Expected* out),
                 expect_by<V>(blocks, count, blur, out))

// Levels of black and of the step to white.
struct Levels {
  float black = 0, step = 1;
  float deviation = 0;  // by the noise expected, without unit; 0: they could not be told
};

template <typename V>
FASTIBL_INLINE void variance_of(const Levels& levels, const V& white, V& variance) {
  const V share = white < 0 ? V{} : white > 1 ? V{} + 1 : white;
  variance = (levels.black > 0 ? levels.black : 0) + levels.step * (share + kDark);
}

// Sums for a line through light by white: weight, white, white², light, white · light, light².
template <typename V>
FASTIBL_INLINE void line_sums_by(const Block* blocks, const Expected* expected, std::size_t count,
                                 const Levels& levels, float* out) {
  for (int i = 0; i < 6; ++i) out[i] = 0;
  for (int lane = 0; lane < kLanes; lane += kFloatsIn<V>) {
    V s[6]{};
    for (std::size_t k = 0; k < count; ++k) {
      const V white = expected[k].at<V>(kMotion, lane), light = blocks[k].at<V>(kLight, lane);
      V variance;
      variance_of(levels, white, variance);
      const V weight = blocks[k].at<V>(kCounts, lane) / variance;
      const V ww = weight * white, wl = weight * light;
      s[0] += weight, s[1] += ww, s[2] += ww * white, s[3] += wl, s[4] += ww * light;
      const V e = light - levels.black - levels.step * white;
      s[5] += weight * e * e;
    }
    for (int i = 0; i < 6; ++i) add_each(s[i], out[i]);
  }
}
FASTIBL_BY_WIDTH(void line_sums(const Block* blocks, const Expected* expected, std::size_t count,
                                const Levels& levels, float* out),
                 line_sums_by<V>(blocks, expected, count, levels, out))

// Normal equations with Tukey's weights, upper part row by row.
template <typename V>
FASTIBL_INLINE void add_products_by(const Block* blocks, const Expected* expected,
                                    std::size_t count, const Levels& levels, float scale,
                                    float* out) {
  for (int i = 0; i < (kSums - 1) * kSums; ++i) out[i] = 0;
  const float reach = 1 / (kTukey * kTukey * scale * scale);
  for (int lane = 0; lane < kLanes; lane += kFloatsIn<V>) {
    V m[kSums - 1][kSums]{};
    for (std::size_t k = 0; k < count; ++k) {
      V row[kSums], variance;
      for (std::size_t i = 0; i < kMotion; ++i) row[i] = levels.step * expected[k].at<V>(i, lane);
      const V white = expected[k].at<V>(kMotion, lane);
      variance_of(levels, white, variance);
      const V e = blocks[k].at<V>(kLight, lane) - levels.black - levels.step * white;
      const V q = 1 - e * e / variance * reach;
      const V weight = (q > 0 ? q * q : V{}) * blocks[k].at<V>(kCounts, lane) / variance;
      row[kMotion] = V{} + 1, row[kMotion + 1] = white, row[kMotion + 2] = e;
      for (int i = 0; i < kSums - 1; ++i) {
        const V w = weight * row[i];
        for (int j = i; j < kSums; ++j) m[i][j] += w * row[j];
      }
    }
    for (int i = 0; i < kSums - 1; ++i)
      for (int j = i; j < kSums; ++j) add_each(m[i][j], out[i * kSums + j]);
  }
}
FASTIBL_BY_WIDTH(void add_products(const Block* blocks, const Expected* expected, std::size_t count,
                                   const Levels& levels, float scale, float* out),
                 add_products_by<V>(blocks, expected, count, levels, scale, out))

// Moves the pixels' places on the board against a motion of the board.
template <typename V>
FASTIBL_INLINE void shift_by(Block* blocks, std::size_t count, const float* motion) {
  for (std::size_t k = 0; k < count; ++k)
    for (int lane = 0; lane < kLanes; lane += kFloatsIn<V>) {
      const auto b = [&](std::size_t field) { return blocks[k].at<V>(field, lane); };
      const V p[3] = {b(kPlace), b(kPlace + 1), b(kPlace + 2)};
      const V d[3] = {motion[1] * p[2] - motion[2] * p[1] + motion[3],
                      motion[2] * p[0] - motion[0] * p[2] + motion[4],
                      motion[0] * p[1] - motion[1] * p[0] + motion[5]};
      V u = b(kU), v = b(kV);
      for (std::size_t i = 0; i < 3; ++i) u -= b(kGu + i) * d[i], v -= b(kGv + i) * d[i];
      blocks[k].set(kU, lane, u), blocks[k].set(kV, lane, v);
    }
}
FASTIBL_BY_WIDTH(void shift(Block* blocks, std::size_t count, const float* motion),
                 shift_by<V>(blocks, count, motion))

Levels levels_of(std::span<const Block> blocks, const Expected* expected) {
  Levels levels;
  std::array<float, 6> s{};
  for (int round = 0; round < 2; ++round) {
    line_sums(blocks.data(), expected, blocks.size(), levels, s.data());
    const double det = double(s[0]) * s[2] - double(s[1]) * s[1];
    if (!(det > 1e-4 * s[0] * s[2])) return {};
    levels.step = float((double(s[0]) * s[4] - double(s[1]) * s[3]) / det);
    levels.black = float((double(s[2]) * s[3] - double(s[1]) * s[4]) / det);
    if (!(levels.step > 0.25f * (levels.black + levels.step) && levels.step > 2e-3f)) return {};
  }
  line_sums(blocks.data(), expected, blocks.size(), levels, s.data());
  levels.deviation = std::sqrt(s[5] / float(kLanes * blocks.size()));
  return levels;
}

// Puts up to 16 pixels of a module into the lanes of a block from `lane` on. fields: what they
// share; own: what they do not, from the first of them on, with 16 readable floats before it.
template <typename V>
FASTIBL_INLINE void put_lanes_by(const float* fields, const float* const* own,
                                 const int* own_fields, int own_count, int lane, int count,
                                 Block& block) {
  using Ints = IntsOf<V>;
  for (int part = 0; part < kLanes; part += kFloatsIn<V>) {
    Ints index;
    for (int l = 0; l < kFloatsIn<V>; ++l) index[l] = part + l;
    // 0 or all bits: differences below 0 have the upper one. Selections by comparison would be made
    // lane by lane.
    const Ints taken = ~((index - lane) >> 31) & ((index - (lane + count)) >> 31);
    const auto set = [&](std::size_t k, const V& value) __attribute__((always_inline)) {
      const V old = block.at<V>(k, part);
      block.set(k, part,
                reinterpret_cast<V>((reinterpret_cast<Ints>(value) & taken) |
                                    (reinterpret_cast<Ints>(old) & ~taken)));
    };
    for (std::size_t k = 0; k < kFields; ++k) set(k, V{} + fields[k]);
    for (int k = 0; k < own_count; ++k)
      set(std::size_t(own_fields[k]), floats_at<V>(own[k] - lane + part));
  }
}
FASTIBL_BY_WIDTH(void put_lanes(const float* fields, const float* const* own, const int* own_fields,
                                int own_count, int lane, int count, Block& block),
                 put_lanes_by<V>(fields, own, own_fields, own_count, lane, count, block))

// Rounds x up; ceil() is a call where processors may lack it.
int next_whole(double x) {
  const int down = int(x);
  return down + (x > down);
}

// Collects the pixels along the black side of edges.
class Collector {
 public:
  Collector(const LightReader& light, const BoardPattern& pattern, const Lens& lens,
            const Pose& pose, double blur)
      : light_(light), pattern_(pattern), lens_(lens), pose_(pose), blur_(blur) {}

  // Adds every `step`-th edge, from the `turn`-th on; `width`: px across the edge.
  void add(const ProjectedTag& tag, std::size_t step, std::size_t& turn, double width,
           std::vector<Block>& blocks) {
    blocks_ = &blocks, lane_ = kLanes;
    const TagPattern& printed = pattern_.tags[tag.index];
    whites(printed);
    for (const TagEdge& edge : printed.edges)
      if (turn++ % step == 0) add(tag, printed, edge, width);
  }

  std::size_t count() const { return count_; }

 private:
  struct Module {
    glm::dvec2 centre, du, dv, twist;
    std::array<float, kFields> fields;
    glm::vec3 at, along_u, along_v;
  };

  void whites(const TagPattern& printed) {
    const int n = pattern_.modules, stride = n + 2, data = n - 2 * pattern_.border;
    white_.assign(std::size_t(stride * stride), 1.0f);
    for (int row = 0; row < n; ++row)
      for (int column = 0; column < n; ++column) {
        const int r = row - pattern_.border, c = column - pattern_.border;
        if (r < 0 || c < 0 || r >= data || c >= data || printed.black[std::size_t(r * data + c)])
          white_[std::size_t((row + 1) * stride + column + 1)] = 0;
      }
  }

  bool module_at(const ProjectedTag& tag, const TagPattern& printed, int row, int column,
                 Module& m) const {
    const int stride = pattern_.nodes();
    const auto k = std::size_t(row * stride + column), below = k + std::size_t(stride);
    const auto& p = tag.nodes;
    const auto& q = printed.nodes;
    m.twist = p[below + 1] - p[below] - p[k + 1] + p[k];
    const glm::dvec2 u = p[k + 1] - p[k] + 0.5 * m.twist, v = p[below] - p[k] + 0.5 * m.twist;
    m.centre = 0.25 * (p[k] + p[k + 1] + p[below] + p[below + 1]);
    const double area = u.x * v.y - u.y * v.x;
    if (!(std::abs(area) > 0.5)) return false;
    m.du = glm::dvec2(v.y, -v.x) / area, m.dv = glm::dvec2(-u.y, u.x) / area;
    const double size_u = 1 / glm::length(m.du), size_v = 1 / glm::length(m.dv);
    if (std::min(size_u, size_v) < kLeastModule * blur_) return false;
    const auto turned = [&](const glm::dvec2& on_board) {
      return pose_.rotation * glm::dvec3(on_board, 0);
    };
    const glm::dvec3 middle = turned(0.5 * (q[k + 1] + q[below]));
    glm::dmat2x3 d;
    if (!lens_.project(middle + pose_.translation, &d)) return false;
    m.at = middle, m.along_u = turned(q[k + 1] - q[k]), m.along_v = turned(q[below] - q[k]);
    m.fields[kSizeU] = float(size_u), m.fields[kSizeV] = float(size_v);
    m.fields[kSlant] = float(glm::dot(m.du, m.dv) * size_u * size_v);
    const glm::dvec3 gu = m.du.x * d[0] + m.du.y * d[1], gv = m.dv.x * d[0] + m.dv.y * d[1];
    for (int i = 0; i < 3; ++i) {
      m.fields[std::size_t(kGu + i)] = float(gu[i]), m.fields[std::size_t(kGv + i)] = float(gv[i]);
      for (int j = 0; j < 3; ++j)
        m.fields[std::size_t(kWhite + 3 * i + j)] =
            white_[std::size_t((row + i) * (stride + 1) + column + j)];
    }
    m.fields[kCounts] = 1;
    return true;
  }

  void add(const ProjectedTag& tag, const TagPattern& printed, const TagEdge& edge, double width) {
    const int stride = pattern_.nodes(), along = int(edge.to) - int(edge.from);
    const bool level = std::abs(along) == 1;
    int row = std::min(edge.from, edge.to) / stride, column = std::min(edge.from, edge.to) % stride;
    if (level && along < 0) --row;  // black is on the right of the edge
    if (!level && along > 0) --column;
    Module m;
    const glm::dvec2 a = tag.nodes[edge.from], b = tag.nodes[edge.to], t = b - a;
    if (!(glm::dot(t, t) < double(light_.width()) * light_.width())) return;
    const bool flat = std::abs(t.x) > std::abs(t.y);
    const int i = flat ? 0 : 1, j = 1 - i;
    const double slope = t[j] / t[i], thick = std::sqrt(1 + slope * slope);
    // Black is on the right of the edge.
    const double side = (flat ? t.x > 0 : t.y < 0) ? 1 : -1;
    const double from = (kBest * blur_ - 0.5 * width) * thick,
                 to = (kBest * blur_ + 0.5 * width) * thick;
    const int begin = std::max(0, next_whole(std::min(a[i], b[i]) - 0.5)),
              end = std::min(flat ? light_.width() : light_.height(),
                             next_whole(std::max(a[i], b[i]) - 0.5));
    const int far = flat ? light_.height() : light_.width();
    if (begin >= end || !module_at(tag, printed, row, column, m)) return;
    for (int x = begin; x < end; ++x) {
      const double on = a[j] + (x + 0.5 - a[i]) * slope - 0.5;
      const double low = side > 0 ? on + from : on - to, high = low + to - from;
      if (!(low > -1 && high < far)) continue;
      for (int y = std::max(0, next_whole(low)); y < std::min(high, double(far)); ++y) {
        x_[found_] = flat ? x : y, y_[found_] = flat ? y : x;
        if (++found_ == kMost) put(m);
      }
    }
    put(m);
  }

  // Puts the pixels that were found, all of one module.
  void put(const Module& m) {
    place_pixels(m);
    for (int k = 0; k < found_; ++k)
      if (light_.channels() == 1)
        light_.read<1, 1>(x_[k], y_[k], false, own(kLightOfOwn) + k);
      else
        light_.read<3, 1>(x_[k], y_[k], false, own(kLightOfOwn) + k);
    constexpr int fields[kOwn] = {kU, kV, kPlace, kPlace + 1, kPlace + 2, kLight};
    for (int from = 0; from < found_;) {
      if (lane_ == kLanes) blocks_->emplace_back(), lane_ = 0;
      const int count = std::min(kLanes - lane_, found_ - from);
      const float* values[kOwn];
      for (int k = 0; k < kOwn; ++k) values[k] = own(k) + from;
      put_lanes(m.fields.data(), values, fields, kOwn, lane_, count, blocks_->back());
      lane_ += count, from += count;
    }
    count_ += std::size_t(found_), found_ = 0;
  }

  // Finds where they are in the module and on the board.
  void place_pixels(const Module& m) {
    for (int k = 0; k < found_; ++k) {
      const double x = x_[k] + 0.5 - m.centre.x, y = y_[k] + 0.5 - m.centre.y;
      double u = m.du.x * x + m.du.y * y, v = m.dv.x * x + m.dv.y * y;
      const double bent_x = u * v * m.twist.x, bent_y = u * v * m.twist.y;
      u -= m.du.x * bent_x + m.du.y * bent_y, v -= m.dv.x * bent_x + m.dv.y * bent_y;
      own(0)[k] = float(u + 0.5), own(1)[k] = float(v + 0.5);
      for (int i = 0; i < 3; ++i)
        own(2 + i)[k] = m.at[i] + float(u) * m.along_u[i] + float(v) * m.along_v[i];
    }
  }

  const LightReader& light_;
  const BoardPattern& pattern_;
  const Lens& lens_;
  const Pose& pose_;
  double blur_;
  std::vector<float> white_;
  std::vector<Block>* blocks_ = nullptr;
  // Pixels of one module, and what of their fields is their own.
  static constexpr int kMost = 128, kOwn = 6, kLightOfOwn = 5;
  int found_ = 0, x_[kMost], y_[kMost];
  float own_[kOwn][kLanes + kMost + kLanes] = {};  // a register may begin before and end after
  float* own(int k) { return own_[k] + kLanes; }
  int lane_ = kLanes;
  std::size_t count_ = 0;
};

using Sums = std::array<double, kMotion*(kMotion + 1)>;  // with the right side

// Adds a tag's pixels; its own levels are eliminated.
void add_tag(std::span<const Block> blocks, const Expected* expected, const Levels& levels,
             float scale, Sums& sums) {
  std::array<float, (kSums - 1) * kSums> m{};
  add_products(blocks.data(), expected, blocks.size(), levels, scale, m.data());
  const auto at = [&](int i, int j) -> double {
    return m[std::size_t(std::min(i, j) * kSums + std::max(i, j))];
  };
  const double a = at(7, 7), b = at(7, 8), c = at(8, 8), det = a * c - b * b;
  if (!(det > 1e-4 * a * c)) return;
  for (int i = 0; i < kMotion; ++i) {
    const double x = (c * at(i, 7) - b * at(i, 8)) / det, y = (a * at(i, 8) - b * at(i, 7)) / det;
    for (int k = 0; k <= kMotion; ++k) {
      const int column = k < kMotion ? k : kMotion + 2;
      sums[std::size_t(i * (kMotion + 1) + k)] +=
          at(i, column) - x * at(7, column) - y * at(8, column);
    }
  }
}

// Solves for motion and widening of the blur. scale: deviation of the pixels by the expected one.
bool solve(const Sums& sums, double scale, PixelFit& fit, std::array<double, 6>& motion,
           double& wider) {
  constexpr std::size_t w = kMotion + 1, b = kMotion - 1;
  const double own = sums[b * w + b];
  if (!(own > 0)) return false;
  std::array<double, 36> a{};
  std::array<double, 6> right{};
  for (std::size_t i = 0; i < 6; ++i) {
    const double share = sums[i * w + b] / own;
    for (std::size_t k = 0; k < 6; ++k) a[6 * i + k] = sums[i * w + k] - share * sums[b * w + k];
    right[i] = sums[i * w + kMotion] - share * sums[b * w + kMotion];
  }
  if (!solve_symmetric<6>(a, right, motion) || !invert<6>(a, fit.covariance, scale * scale))
    return false;
  wider = sums[b * w + kMotion];
  for (std::size_t k = 0; k < 6; ++k) wider -= sums[b * w + k] * motion[k];
  wider /= own;
  return std::isfinite(wider);
}

}  // namespace

std::optional<PixelFit> fit_pixels(const LightReader& light, const BoardPattern& pattern,
                                   std::span<const ProjectedTag> tags, const Lens& lens,
                                   const Pose& pose, double blur, std::size_t most) {
  PixelFit fit;
  fit.blur = std::clamp(blur, kLeastBlur, kMostBlur);
  double length = 0;
  for (const ProjectedTag& tag : tags)
    length += tag.module * double(pattern.tags[tag.index].edges.size());
  if (!(length > kLeastPixels)) return std::nullopt;
  const double width = std::clamp(double(most) / length, kNarrowest * fit.blur, kWidest * fit.blur);
  const auto step = std::size_t(std::max(1.0, std::round(length * width / double(most))));
  Collector collector(light, pattern, lens, pose, fit.blur);
  std::vector<Block> blocks;
  blocks.reserve(most / kLanes + tags.size());
  std::vector<std::size_t> ends;
  std::size_t turn = 0;
  for (const ProjectedTag& tag : tags) {
    collector.add(tag, step, turn, width, blocks);
    ends.push_back(blocks.size());
  }
  fit.pixels = collector.count();
  std::vector<Expected> expected(blocks.size());
  std::vector<Levels> levels(tags.size());
  for (int round = 0; round < 2; ++round) {
    expect(blocks.data(), blocks.size(), float(fit.blur), expected.data());
    std::vector<float> deviations;
    std::size_t begin = 0;
    for (std::size_t k = 0; k < tags.size(); begin = ends[k++]) {
      levels[k] = {};
      if ((ends[k] - begin) * kLanes < kLeastPixels) continue;
      levels[k] = levels_of(std::span(blocks).subspan(begin, ends[k] - begin), &expected[begin]);
      if (levels[k].deviation > 0) deviations.push_back(levels[k].deviation);
    }
    if (deviations.empty()) return std::nullopt;
    const auto middle = deviations.begin() + std::ptrdiff_t(deviations.size() / 2);
    std::nth_element(deviations.begin(), middle, deviations.end());
    const float scale = std::max(*middle, 1e-4f);
    Sums sums{};
    begin = 0;
    for (std::size_t k = 0; k < tags.size(); begin = ends[k++])
      if (levels[k].deviation > 0 && levels[k].deviation < kBadTag * scale)
        add_tag(std::span(blocks).subspan(begin, ends[k] - begin), &expected[begin], levels[k],
                scale, sums);
    std::array<double, 6> motion{};
    double wider = 0;
    if (!solve(sums, scale, fit, motion, wider)) return std::nullopt;
    std::array<float, 6> moved{};
    for (std::size_t k = 0; k < 6; ++k) fit.motion[k] += motion[k], moved[k] = float(motion[k]);
    fit.blur = std::clamp(fit.blur + std::clamp(wider, -0.4 * fit.blur, 0.6 * fit.blur), kLeastBlur,
                          kMostBlur);
    shift(blocks.data(), blocks.size(), moved.data());
  }
  return fit;
}

}  // namespace fastibl
