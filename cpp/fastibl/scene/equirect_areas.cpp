// A texel's mean is a sum over pieces of azimuth, each within one column of pixels. The meridian in
// the middle of a piece crosses the edges of texels one after the other. The difference between two
// crossings in the sine of the latitude, times the piece's azimuth, is a solid angle. The light of
// a column down to a crossing is a sum over whole rows and a part of one; a texel takes the
// difference of two such sums. Texels share their crossings, so every part of the picture is
// counted once.
#include <algorithm>
#include <cmath>
#include <vector>

#include "fastibl/core/simd.h"
#include "fastibl/scene/arctangent.h"
#include "fastibl/scene/equirect_filters.h"

namespace fastibl {
namespace {

constexpr double kPiDouble = std::numbers::pi;
using Double4 [[gnu::vector_size(32), gnu::aligned(8)]] = double;

// By texel of a face: light in RGB, and the solid angle that it was summed over.
using Sums = std::vector<float>;

glm::vec3 mean(const float* sum) {
  return sum[3] > 0 ? glm::vec3(sum[0], sum[1], sum[2]) / sum[3] : glm::vec3(0);
}

constexpr int kBlock = 8;  // columns

// Appends rows to `count` columns: their values, and the sums of the rows above them.
FASTIBL_CLONES void read_rows(const float* pixels, std::ptrdiff_t row_stride, int rows, int count,
                              const double* ends, std::size_t stride, std::size_t at,
                              double* __restrict sums, double* __restrict above,
                              double* __restrict value) {
  const Float4 one = {1, 1, 1, 1};
  if (at == 0) std::fill_n(sums, 4 * kBlock, 0.0);
  for (int y = 0; y < rows; ++y, pixels += row_stride) {
    const double height = ends[y] - ends[y + 1];
    const std::size_t to = at + 4 * std::size_t(y);
    for (int k = 0; k < count; ++k) {
      const Float4 rgb = *reinterpret_cast<const Float4*>(pixels + 3 * k);
      const Double4 light =
          __builtin_convertvector(__builtin_shufflevector(rgb, one, 0, 1, 2, 4), Double4);
      Double4& sum = *reinterpret_cast<Double4*>(sums + 4 * k);
      *reinterpret_cast<Double4*>(value + std::size_t(k) * stride + to) = light;
      *reinterpret_cast<Double4*>(above + std::size_t(k) * stride + to) = sum;
      sum += height * light;
    }
  }
}

// A column of pixels: light, and a 1 whose sum is a solid angle, both per azimuth.
class Columns {
 public:
  explicit Columns(ImageView<const float> picture) : image(picture) {
    for (int y = 0; y <= image.height; ++y) ends.push_back(std::cos(y * kPiDouble / image.height));
    // Unlike the rows of many pictures, columns begin in different sets of the cache.
    stride_ = 4 * std::size_t(image.height) + 16;
    above_.resize(kBlock * stride_);
    value_.resize(above_.size());
  }
  // Columns are read in blocks, row by row. True if this call read them.
  bool load(int x) {
    offset_ = std::size_t(x % kBlock) * stride_;
    if (x / kBlock == block_) return false;
    block_ = x / kBlock;
    const int count = std::min(kBlock, image.width - block_ * kBlock);
    // Pixels are read as four floats, but the very last one has no fourth.
    const int last = image.height - 1;
    read_rows(image.pixel(block_ * kBlock, 0), image.stride(), last, count, ends.data(), stride_, 0,
              sums_, above_.data(), value_.data());
    float row[3 * kBlock + 1] = {};
    std::copy_n(image.pixel(block_ * kBlock, last), 3 * count, row);
    read_rows(row, 0, 1, count, ends.data() + last, stride_, 4 * std::size_t(last), sums_,
              above_.data(), value_.data());
    return true;
  }
  const Double4* above() const {  // by row: the sum of the rows above it
    return reinterpret_cast<const Double4*>(&above_[offset_]);
  }
  const Double4* value() const { return reinterpret_cast<const Double4*>(&value_[offset_]); }

  ImageView<const float> image;
  std::vector<double> ends;  // sine of the latitude at which rows begin

 private:
  double sums_[4 * kBlock];
  std::vector<double> above_, value_;  // four a pixel, column by column
  std::size_t stride_, offset_ = 0;
  int block_ = -1;
};

// The light above a crossing, which is given by its sine and row.
FASTIBL_INLINE void light_above(const double* ends, const Double4* above, const Double4* value,
                                float sine, int row, Double4& out) {
  out = above[row] + (ends[row] - double(sine)) * value[row];
}

// Cuts columns [from, to) of the picture into pieces, each within one pixel and at most 1 / split
// of it. body(column of pixels, azimuth of the middle, width of the piece, both in radians)
template <typename Body>
void for_pieces(double from, double to, int width, int split, Body&& body) {
  const double to_radians = 2 * kPiDouble / width;
  for (double begin = from; begin < to - 1e-9;) {
    const double end = std::min(to, (std::floor(begin * split + 1e-7) + 1) / split);
    const double middle = 0.5 * (begin + end);
    const int column = int(std::floor(middle)) % width;
    body(column < 0 ? column + width : column, (middle / width - 0.5) * 2 * kPiDouble,
         (end - begin) * to_radians);
    begin = end;
  }
}

// Sine and row of latitudes atan(h cos ψ).
FASTIBL_CLONES void cross_heights(const float* __restrict heights, float cosine, int count,
                                  int rows, float* __restrict sine, int* __restrict row) {
  const float scale = float(rows) / std::numbers::pi_v<float>;
  for (int i = 0; i < count; ++i) {
    const float t = heights[i] * cosine;
    sine[i] = t / std::sqrt(1 + t * t);
    const float angle = first_quadrant_angle(std::fabs(t), 1.0f);
    const int at = int((0.5f * std::numbers::pi_v<float> - (t < 0 ? -angle : angle)) * scale);
    row[i] = at > 0 ? (at < rows - 1 ? at : rows - 1) : 0;
  }
}

// Adds a meridian's light between crossings to `count` texels in a row.
FASTIBL_CLONES void add_line(const double* __restrict ends, const Double4* __restrict above,
                             const Double4* __restrict value, const float* __restrict sine,
                             const int* __restrict row, int count, float width,
                             float* __restrict line) {
  Double4 before;
  light_above(ends, above, value, sine[0], row[0], before);
  for (int k = 0; k < count; ++k) {
    Double4 after;
    light_above(ends, above, value, sine[k + 1], row[k + 1], after);
    Float4* sum = reinterpret_cast<Float4*>(line + 4 * k);
    *sum += width * __builtin_convertvector(after - before, Float4);
    before = after;
  }
}

// A ray from the middle of a face towards an edge, which it meets at 1: at distance X towards the
// edge it is slope · X to the side. It crosses the lines X_k of texels, and between two of them at
// most one line of the other direction; before that line it is in the texel first_k, after it in
// second_k.
// sine, row: absolute sine of the latitude, and row from the pole, of X_0, side_0, X_1, side_1, …
// texels: first_0, second_0, first_1, …, by their index to the side.
FASTIBL_CLONES void cast_ray(const float* __restrict lines, int count, float cosine, float slope,
                             int n, int rows, float* __restrict sine, int* __restrict row,
                             int* __restrict texels) {
  const float half = 0.5f * float(n), scale = float(rows) / std::numbers::pi_v<float>;
  const float steep = std::fabs(slope) > 1e-12f ? 1 / slope : 0.0f;
  const float inverse = 1 / cosine;
  for (int k = 0; k < count; ++k) {
    const float begin = lines[k], end = lines[k + 1];
    const float to_begin = (begin * slope + 1) * half, to_end = (end * slope + 1) * half;
    int first = int(to_begin), second = int(to_end);
    first = first < n - 1 ? first : n - 1, second = second < n - 1 ? second : n - 1;
    const int line = first > second ? first : second;
    const float crossing = (float(line) / half - 1) * steep;
    const float within = crossing > begin ? (crossing < end ? crossing : end) : begin;
    const float side = first == second ? end : within;
    texels[2 * k] = first, texels[2 * k + 1] = second;
    const float x0 = begin * inverse, x1 = side * inverse;
    sine[2 * k] = 1 / std::sqrt(1 + x0 * x0), sine[2 * k + 1] = 1 / std::sqrt(1 + x1 * x1);
    const int r0 = int(first_quadrant_angle(x0, 1.0f) * scale);
    const int r1 = int(first_quadrant_angle(x1, 1.0f) * scale);
    row[2 * k] = r0 < rows - 1 ? r0 : rows - 1, row[2 * k + 1] = r1 < rows - 1 ? r1 : rows - 1;
  }
}

// Adds a ray's light to the texels that it passes: base + k · along + texels · across, in texels.
FASTIBL_CLONES void add_ray(const double* __restrict ends, const Double4* __restrict above,
                            const Double4* __restrict value, const float* __restrict sine,
                            const int* __restrict row, const int* __restrict texels, int count,
                            int bottom_row, std::ptrdiff_t along, std::ptrdiff_t across,
                            float width, float* __restrict sums) {
  // At the lower pole rows are counted from below, and the light above grows towards the pole.
  const bool top = bottom_row < 0;
  const float sign = top ? 1.0f : -1.0f;
  const auto row_of = [&](int k) { return top ? row[k] : bottom_row - row[k]; };
  Double4 before;
  light_above(ends, above, value, sign * sine[0], row_of(0), before);
  for (int k = 0; k < count; ++k, sums += 4 * along) {
    Double4 after;
    light_above(ends, above, value, sign * sine[2 * k + 1], row_of(2 * k + 1), after);
    Float4* first = reinterpret_cast<Float4*>(sums + 4 * texels[2 * k] * across);
    *first += (sign * width) * __builtin_convertvector(after - before, Float4);
    before = after;
    if (texels[2 * k] == texels[2 * k + 1]) continue;  // `side` was the end
    light_above(ends, above, value, sign * sine[2 * k + 2], row_of(2 * k + 2), after);
    Float4* second = reinterpret_cast<Float4*>(sums + 4 * texels[2 * k + 1] * across);
    *second += (sign * width) * __builtin_convertvector(after - before, Float4);
    before = after;
  }
}

// The faces ±z; each meridian serves both.
class Caps {
 public:
  Caps(const Columns& column, int size)
      : n_(size),
        // Rays are so dense that several meet every texel at the edge.
        split_(std::max(1, int(std::ceil(24.0 * size / column.image.width)))),
        done_(std::size_t(column.image.width), false) {
    // From the middle of a face to its edge.
    for (int k = 1; k <= (n_ + 1) / 2; ++k) lines_.push_back(float(2 * k - n_ % 2) / float(n_));
    sine_.resize(2 * lines_.size()), row_.resize(2 * lines_.size());
    texels_.resize(2 * lines_.size());
    for (Sums& s : sums_) s.assign(4 * std::size_t(n_) * std::size_t(n_), 0.0f);
  }

  // Adds the rays of a block of columns once.
  void add_block(int x, Columns& column) {
    const int begin = x / kBlock * kBlock, end = std::min(begin + kBlock, column.image.width);
    if (done_[std::size_t(begin)]) return;
    done_[std::size_t(begin)] = true;
    for_pieces(begin, end, column.image.width, split_, [&](int at, double azimuth, double width) {
      column.load(at);
      add(azimuth, width, column);
    });
  }

  void finish(Columns& column, CubeLevel& faces) {
    for (int x = 0; x < column.image.width; x += kBlock) add_block(x, column);
    for (int face = 4; face < 6; ++face)
      for (int y = 0; y < n_; ++y)
        for (int x = 0; x < n_; ++x)
          faces.texel(face, x, y) =
              mean(&sums_[face - 4][4 * (std::size_t(y) * std::size_t(n_) + std::size_t(x))]);
  }

 private:
  void add(double azimuth, double width, const Columns& column) {
    const int height = column.image.height, count = int(lines_.size()) - 1;
    // Face coordinates of the ray on +z: a to the right, b down; on −z a is reversed.
    const double a = std::sin(azimuth), b = -std::cos(azimuth);
    const bool by_a = std::abs(a) > std::abs(b);
    const double major = by_a ? a : b, minor = by_a ? b : a;
    const float cosine = float(std::abs(major)), slope = float(minor / std::abs(major));
    cast_ray(lines_.data(), count, cosine, slope, n_, height, sine_.data(), row_.data(),
             texels_.data());
    // The last crossing is the edge.
    const float edge = 1 / cosine;
    sine_[2 * std::size_t(count)] = 1 / std::sqrt(1 + edge * edge);
    row_[2 * std::size_t(count)] =
        std::clamp(int(std::atan(edge) / std::numbers::pi_v<float> * float(height)), 0, height - 1);
    for (const bool top : {true, false}) {
      // Texel indices: from the middle along the major axis, and by `texels` along the other.
      const bool reversed_a = !top;
      const bool forward = (major > 0) != (by_a && reversed_a);
      const std::ptrdiff_t along_step = by_a ? 1 : n_, across_step = by_a ? n_ : 1;
      const std::ptrdiff_t start = forward ? n_ / 2 : (n_ - 1) / 2;
      const bool mirrored = !by_a && reversed_a;
      const std::ptrdiff_t base = start * along_step + (mirrored ? (n_ - 1) * across_step : 0);
      add_ray(column.ends.data(), column.above(), column.value(), sine_.data(), row_.data(),
              texels_.data(), count, top ? -1 : height - 1, forward ? along_step : -along_step,
              mirrored ? -across_step : across_step, float(width),
              &sums_[top ? 0 : 1][4 * std::size_t(base)]);
    }
  }

  int n_, split_;
  std::vector<bool> done_;
  std::vector<float> lines_{0}, sine_;
  std::vector<int> row_, texels_;
  Sums sums_[2];
};

// The faces ±x, ±y: edges of texels are meridians in one direction. In the other they lie at a
// height h above the face's middle: at latitude atan(h cos ψ) for azimuth ψ from the middle.
void resample_side(int face, Columns& column, Caps& caps, CubeLevel& faces) {
  const int n = faces.size();
  // Azimuth atan2(x, y) of the face's middle, and the sign with which it grows along its texel
  // coordinate.
  const double middle[4] = {kPiDouble / 2, -kPiDouble / 2, 0, kPiDouble};
  const int sign[4] = {1, -1, 1, -1};
  const bool by_row = face < 2;                 // azimuth goes with t; then height goes with s
  const bool falling = face == 0 || face == 3;  // height falls with the other coordinate
  std::vector<float> heights, sine(std::size_t(n) + 1);
  std::vector<int> row(std::size_t(n) + 1);
  for (int k = 0; k <= n; ++k) heights.push_back(1 - 2 * float(k) / float(n));
  Sums line(4 * std::size_t(n));
  for (int i = 0; i < n; ++i) {
    std::fill(line.begin(), line.end(), 0.0f);
    double ends[2];
    for (int e = 0; e < 2; ++e)
      ends[e] =
          ((middle[face] + sign[face] * std::atan(2.0 * (i + e) / n - 1)) / (2 * kPiDouble) + 0.5) *
          column.image.width;
    for_pieces(std::min(ends[0], ends[1]), std::max(ends[0], ends[1]), column.image.width, 2,
               [&](int x, double azimuth, double width) {
                 if (column.load(x)) {  // while they are loaded
                   caps.add_block(x, column);
                   column.load(x);
                 }
                 cross_heights(heights.data(), float(std::cos(azimuth - middle[face])), n + 1,
                               column.image.height, sine.data(), row.data());
                 add_line(column.ends.data(), column.above(), column.value(), sine.data(),
                          row.data(), n, float(width), line.data());
               });
    for (int k = 0; k < n; ++k) {
      const int other = falling ? k : n - 1 - k;
      faces.texel(face, by_row ? other : i, by_row ? i : other) = mean(&line[4 * std::size_t(k)]);
    }
  }
}

}  // namespace

void resample_areas(ImageView<const float> image, CubeLevel& faces) {
  Columns column(image);
  Caps caps(column, faces.size());
  for (int face = 0; face < 4; ++face) resample_side(face, column, caps, faces);
  caps.finish(column, faces);
}

}  // namespace fastibl
